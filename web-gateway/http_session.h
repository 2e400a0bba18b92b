// The connections of a gateway. Only this room's sources include this.

#ifndef ISOSCOPE_WEB_GATEWAY_HTTP_SESSION_H_
#define ISOSCOPE_WEB_GATEWAY_HTTP_SESSION_H_

#include <memory>
#include <string>

#include "core/base/trace_context.h"
#include "core/http/connections.h"
#include "core/http/peer_address.h"
#include "core/http/peer_stream.h"
#include "web-gateway/api/api.h"
#include "web-gateway/api/coordinator_client.h"
#include "web-gateway/gateway_metrics.h"
#include "web-gateway/gateway_server.h"
#include "web-gateway/http/access.h"
#include "web-gateway/known_tokens.h"

namespace isoscope::gateway {

// The parts of a gateway that its connections use; outlives them.
struct GatewayParts {
  GatewayLimits limits;
  AccessRules access;
  CoordinatorClient* client = nullptr;
  Api* api = nullptr;
  GatewayMetrics* metrics = nullptr;
  KnownTokens* tokens = nullptr;
  http::TrustedProxies proxies = {};
};

// Serves a connection until its end.
void ServeHttp(std::shared_ptr<http::PeerStream> stream, GatewayParts* parts,
               std::shared_ptr<http::Connections::Lease> lease);

// Serves a WebSocket of /v1/interact on the strand of `stream`, whose request was checked and asks
// for it. `token`: the user's, for the coordinator; empty: none.
void ServeWebSocket(std::shared_ptr<http::PeerStream> stream, std::string token,
                    const base::TraceContext& identity, GatewayParts* parts,
                    std::shared_ptr<http::Connections::Lease> lease);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_HTTP_SESSION_H_
