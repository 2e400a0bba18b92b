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
#include "web-gateway/access.h"

namespace grpc {
class Channel;
}  // namespace grpc

namespace isoscope::gateway {

// Limits of what a client may hold or cost.
struct GatewayLimits {
  int max_connections = 256;  // of all kinds; more are answered with 503
  int max_pictures = 16;      // pictures, picks and meshes in work; more are answered with 429
  int max_caller_meshes = 2;  // meshes of a caller, until they are sent; more: 429
  // Disk space of all meshes, until they are sent; a mesh that needs more: 429.
  std::int64_t max_mesh_bytes = std::int64_t{2} << 30;
  // Of a picture, a pick or a mesh.
  absl::Duration max_picture_duration = absl::Minutes(5);
  // In which a request must have come whole, from its first byte on.
  absl::Duration request_timeout = absl::Seconds(10);
  // Between two requests of a connection; also the most silence of a WebSocket, whose client
  // answers pings.
  absl::Duration idle_timeout = absl::Seconds(60);
  // In which a client must take a piece of an answer, or a frame.
  absl::Duration write_timeout = absl::Seconds(20);
};

struct GatewayOptions {
  std::shared_ptr<grpc::Channel> channel;         // to the coordinator
  std::string coordinator_address = {};           // for messages; empty: in this process
  std::string coordinator_token = {};             // of calls whose user has none; empty: none
  std::string listen_address = "127.0.0.1:8080";  // "HOST:PORT"; port 0 takes a free one
  // The certificate for https and wss, and its key, PEM; empty: http. Read again when they change.
  std::string certificate_file = {};
  std::string key_file = {};
  AccessOptions access = {};  // listens_on_loopback is set from the address
  GatewayLimits limits = {};
  int thread_count = 2;
};

// Thread-safe.
class GatewayServer {
 public:
  // INVALID_ARGUMENT: the certificate can't be used. UNAVAILABLE: the address can't be bound. The
  // coordinator need not be there yet.
  static absl::StatusOr<std::unique_ptr<GatewayServer>> Start(const GatewayOptions& options);
  // Calls Shutdown without grace.
  virtual ~GatewayServer() = default;

  [[nodiscard]] virtual int port() const = 0;
  // Returns the numbers for monitoring (gateway_metrics).
  virtual std::vector<base::MetricFamily> CollectMetrics() = 0;
  // Takes no new connections, closes WebSockets with 1001, lets answers in work end for at most
  // `grace`, then cancels them. Blocks.
  virtual void Shutdown(absl::Duration grace) = 0;
};

// The address of the page for people: "http://HOST:PORT/" (https: with TLS), with this machine's
// name in place of an address that stands for all of its own, and with "?token=..." if there is
// one.
std::string PageAddress(const std::string& listen_address, int port, const std::string& token,
                        bool has_tls);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_GATEWAY_SERVER_H_
