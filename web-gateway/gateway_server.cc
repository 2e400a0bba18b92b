// Owns the listener and all parts. They end in this order: connections; then calls to the
// coordinator, whose callbacks still post to the threads; then the threads.

#include "web-gateway/gateway_server.h"

#include <unistd.h>

#include <array>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

#include "core/base/log.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/rpc/certificate_watch.h"
#include "core/rpc/host_port.h"
#include "web-gateway/http_session.h"
#include "web-gateway/peer_listener.h"
#include "web-gateway/tls_context.h"
#include "web-gateway/url.h"

namespace isoscope::gateway {
namespace {

// The time that connections may take to close after the request to do so.
constexpr absl::Duration kCloseGrace = absl::Seconds(5);

constexpr absl::string_view kTooManyConnections =
    "HTTP/1.1 503 Service Unavailable\r\nContent-Type: application/json\r\n"
    "Retry-After: 1\r\nConnection: close\r\nContent-Length: 89\r\n\r\n"
    "{\"code\":\"UNAVAILABLE\",\"message\":\"too many connections (--max-connections): retry "
    "later\"}\n";

class GatewayServerImpl final : public GatewayServer {
 public:
  explicit GatewayServerImpl(const GatewayOptions& options)
      : connections_(options.limits.max_connections),
        client_({.channel = options.channel,
                 .address = options.coordinator_address,
                 .token = options.coordinator_token,
                 .max_duration = options.limits.max_picture_duration}),
        parts_{.limits = options.limits,
               .access = AccessRules(AccessFor(options)),
               .client = &client_,
               .api = &api_,
               .metrics = &metrics_},
        api_({.max_pictures = options.limits.max_pictures,
              .max_caller_meshes = options.limits.max_caller_meshes,
              .max_mesh_bytes = options.limits.max_mesh_bytes,
              .is_private = parts_.access.asks_token(),
              .passes_tokens = !parts_.access.has_token()},
             &client_),
        certificate_(options.certificate_file),
        listener_(PeerListener::Make()) {}
  ~GatewayServerImpl() override {
    Shutdown(absl::ZeroDuration());
    client_.AwaitCalls();
  }

  absl::Status Listen(const GatewayOptions& options) {
    std::unique_ptr<TlsContext> tls;
    if (!options.certificate_file.empty()) {
      ISOSCOPE_ASSIGN_OR_RETURN(tls, TlsContext::Make(options.certificate_file, options.key_file));
    }
    // The resolver would take 99999 for another port.
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string address,
                              rpc::ParseHostPort(options.listen_address));
    const std::size_t colon = address.rfind(':');
    std::string host = address.substr(0, colon);
    if (host.size() > 2 && host.front() == '[') {
      host = host.substr(1, host.size() - 2);
    }
    has_tls_ = tls != nullptr;
    return listener_->Listen(host, address.substr(colon + 1), address, std::move(tls),
                             options.thread_count,
                             [this](const std::shared_ptr<PeerStream>& stream) { Serve(stream); });
  }

  [[nodiscard]] int port() const override { return listener_->port(); }

  std::vector<base::MetricFamily> CollectMetrics() override {
    return metrics_.Collect({.connections = connections_.count(),
                             .max_connections = parts_.limits.max_connections,
                             .pictures = api_.pictures_in_work(),
                             .max_pictures = parts_.limits.max_pictures,
                             .certificate_days_left = certificate_.DaysLeft(),
                             .certificate_failures = certificate_.failures()});
  }

  void Shutdown(absl::Duration grace) override {
    listener_->Close();
    connections_.Close(/*at_once=*/false);
    if (!connections_.AwaitNone(base::MonotonicNow() + grace)) {
      connections_.Close(/*at_once=*/true);
      connections_.AwaitNone(base::MonotonicNow() + kCloseGrace);
    }
  }

 private:
  static AccessOptions AccessFor(const GatewayOptions& options) {
    AccessOptions access = options.access;
    access.listens_on_loopback = IsLoopback(options.listen_address);
    return access;
  }

  void Serve(const std::shared_ptr<PeerStream>& stream) {
    std::shared_ptr<Connections::Lease> lease = connections_.TryAdd();
    if (lease != nullptr) {
      ServeHttp(stream, &parts_, std::move(lease));
      return;
    }
    if (connections_.is_closing()) {
      return;  // connections that came before also end without an answer
    }
    metrics_.refused.Add();
    if (!has_tls_) {  // with TLS an answer would cost a handshake
      stream->Refuse(kTooManyConnections);
    }
  }

  GatewayMetrics metrics_;
  Connections connections_;
  CoordinatorClient client_;
  GatewayParts parts_;
  Api api_;
  bool has_tls_ = false;
  rpc::CertificateWatch certificate_;
  std::unique_ptr<PeerListener> listener_;  // ends first: its threads use the parts
};

}  // namespace

absl::StatusOr<std::unique_ptr<GatewayServer>> GatewayServer::Start(const GatewayOptions& options) {
  auto server = std::make_unique<GatewayServerImpl>(options);
  ISOSCOPE_RETURN_IF_ERROR(server->Listen(options));
  return server;
}

std::string PageAddress(const std::string& listen_address, int port, const std::string& token,
                        bool has_tls) {
  std::string host = listen_address.substr(0, listen_address.rfind(':'));
  if (host == "0.0.0.0" || host == "[::]") {
    constexpr std::size_t kMaxNameBytes = 256;
    std::array<char, kMaxNameBytes> name{};
    host = gethostname(name.data(), name.size() - 1) == 0 ? name.data() : "localhost";
  }
  return absl::StrCat(has_tls ? "https://" : "http://", host, ":", port, "/",
                      token.empty() ? "" : "?token=", EscapeQueryValue(token));
}

}  // namespace isoscope::gateway
