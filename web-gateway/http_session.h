// The connections of a gateway, on Boost.Beast. Only this room's sources include this.

#ifndef ISOSCOPE_WEB_GATEWAY_HTTP_SESSION_H_
#define ISOSCOPE_WEB_GATEWAY_HTTP_SESSION_H_

#include <memory>
#include <string>

#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/http/message.hpp>
#include <boost/beast/http/string_body.hpp>

#include "core/base/trace_context.h"
#include "web-gateway/access.h"
#include "web-gateway/api.h"
#include "web-gateway/connections.h"
#include "web-gateway/coordinator_client.h"
#include "web-gateway/gateway_metrics.h"
#include "web-gateway/gateway_server.h"
#include "web-gateway/peer_stream.h"

namespace isoscope::gateway {

// The parts of a gateway that its connections use; outlives them.
struct GatewayParts {
  GatewayLimits limits;
  AccessRules access;
  CoordinatorClient* client = nullptr;
  Api* api = nullptr;
  GatewayMetrics* metrics = nullptr;
};

// Serves a connection until its end. `stream` has a strand of its own.
void ServeHttp(PeerStream stream, GatewayParts* parts, std::shared_ptr<Connections::Lease> lease);

// Serves a WebSocket of /v1/interact. `upgrade`: the request that asks for it, checked. `token`:
// the user's, for the coordinator; empty: none.
void ServeWebSocket(PeerStream stream, std::string token,
                    boost::beast::http::request<boost::beast::http::string_body> upgrade,
                    const base::TraceContext& identity, GatewayParts* parts,
                    std::shared_ptr<Connections::Lease> lease);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_HTTP_SESSION_H_
