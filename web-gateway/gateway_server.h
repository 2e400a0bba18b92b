// The running gateway: HTTP and WebSocket on one port, in front of one coordinator.

#ifndef ISOSCOPE_WEB_GATEWAY_GATEWAY_SERVER_H_
#define ISOSCOPE_WEB_GATEWAY_GATEWAY_SERVER_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "core/base/metrics.h"
#include "core/http/peer_address.h"
#include "web-gateway/http/access.h"

namespace grpc {
class Channel;
}  // namespace grpc

namespace isoscope::gateway {

// Limits of a client's resources and costs.
struct GatewayLimits {
  // Connections at work, of all kinds; more are answered with 503. Those that wait for a request
  // make room (core/http/connections.h).
  int max_connections = 256;
  int max_pictures = 16;      // pictures, picks, meshes, films in work; more are answered with 429
  int max_caller_meshes = 2;  // meshes and films of a caller, until they are sent; more: 429
  // Disk space of all meshes and films, until they are sent; one that needs more: 429.
  std::int64_t max_mesh_bytes = std::int64_t{2} << 30;
  // The limit of a picture, a pick or a mesh.
  absl::Duration max_picture_duration = absl::Minutes(5);
  // A request must arrive completely within this time, from its first byte on.
  absl::Duration request_timeout = absl::Seconds(10);
  // The longest pause between two requests of a connection. Also the longest silence of a
  // WebSocket, whose client answers pings.
  absl::Duration idle_timeout = absl::Seconds(60);
  // A client must take a piece of an answer, or a frame, within this time.
  absl::Duration write_timeout = absl::Seconds(20);
  // The least rate of an answer, on average, after write_timeout.
  double min_bytes_per_second = 4 * 1024;
};

struct GatewayOptions {
  std::shared_ptr<grpc::Channel> channel;         // to the coordinator
  std::string coordinator_address = {};           // for messages; empty: in this process
  std::string coordinator_token = {};             // for calls whose user has none; empty: none
  std::string listen_address = "127.0.0.1:8080";  // "HOST:PORT"; port 0 takes a free one
  // The certificate for https and wss, and its key, PEM; empty: http. Read again when they change.
  std::string certificate_file = {};
  std::string key_file = {};
  AccessOptions access = {};  // listens_on_loopback is set from the address
  // Origins of pages that may have the page in a frame, as ParseOrigin returns them.
  std::vector<std::string> framing_origins = {};
  // Proxies in front, whose X-Forwarded-For names the callers.
  http::TrustedProxies trusted_proxies = {};
  GatewayLimits limits = {};
  int thread_count = 2;
};

// Thread-safe.
class GatewayServer {
 public:
  // INVALID_ARGUMENT: the certificate can't be used. UNAVAILABLE: the address can't be bound. The
  // coordinator may start later.
  static absl::StatusOr<std::unique_ptr<GatewayServer>> Start(const GatewayOptions& options);
  // Calls Shutdown without grace.
  virtual ~GatewayServer() = default;

  [[nodiscard]] virtual int port() const = 0;
  // Returns the metrics for monitoring (gateway_metrics).
  virtual std::vector<base::MetricFamily> CollectMetrics() = 0;
  // Takes no new connections, closes WebSockets with 1001, lets answers in work finish for at most
  // `grace`, then cancels them. Blocks.
  virtual void Shutdown(absl::Duration grace) = 0;
};

// Returns the page's address for users: "http://HOST:PORT/" (https: with TLS), with "?token=..." if
// there is a token. This machine's name replaces an address that stands for all of its interfaces.
std::string PageAddress(const std::string& listen_address, int port, const std::string& token,
                        bool has_tls);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_GATEWAY_SERVER_H_
