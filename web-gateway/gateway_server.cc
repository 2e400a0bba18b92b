// Owns the listener and all parts. They end in this order: connections; then calls to the
// coordinator and annotations, whose callbacks still post to the threads; then the threads.

#include "web-gateway/gateway_server.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

#include "core/base/log.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/http/peer_address.h"
#include "core/http/peer_listener.h"
#include "core/http/tls_context.h"
#include "rpc/certificate_watch.h"
#include "rpc/host_port.h"
#include "web-gateway/http/url.h"
#include "web-gateway/http_session.h"
#include "web-gateway/known_tokens.h"

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
      : connections_(ConnectionLimitsFor(options)),
        client_({.channel = options.channel,
                 .address = options.coordinator_address,
                 .token = options.coordinator_token,
                 .max_duration = options.limits.max_picture_duration}),
        parts_{.limits = options.limits,
               .access = AccessRules(AccessFor(options)),
               .client = &client_,
               .api = &api_,
               .metrics = &metrics_,
               .tokens = &tokens_,
               .proxies = options.trusted_proxies},
        api_({.max_pictures = options.limits.max_pictures,
              .max_caller_meshes = options.limits.max_caller_meshes,
              .max_mesh_bytes = options.limits.max_mesh_bytes,
              .is_private = parts_.access.asks_token(),
              .passes_tokens = !parts_.access.has_token(),
              .framing_origins = options.framing_origins},
             &client_),
        certificate_(options.certificate_file),
        listener_(http::PeerListener::Make()) {}
  ~GatewayServerImpl() override {
    Shutdown(absl::ZeroDuration());
    client_.AwaitCalls();
    api_.FinishDrawing();
    client_.AwaitCalls();  // of films that asked for another frame meanwhile
  }

  absl::Status Listen(const GatewayOptions& options) {
    std::unique_ptr<http::TlsContext> tls;
    if (!options.certificate_file.empty()) {
      ISOSCOPE_ASSIGN_OR_RETURN(tls,
                                http::TlsContext::Make(options.certificate_file, options.key_file));
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
    return listener_->Listen(
        host, address.substr(colon + 1), address, std::move(tls), options.thread_count,
        [this](const std::shared_ptr<http::PeerStream>& stream) { Serve(stream); });
  }

  [[nodiscard]] int port() const override { return listener_->port(); }

  std::vector<base::MetricFamily> CollectMetrics() override {
    return metrics_.Collect({.connections = connections_.count(),
                             .max_connections = parts_.limits.max_connections,
                             .dropped_connections = connections_.dropped_count(),
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

  static http::ConnectionLimits ConnectionLimitsFor(const GatewayOptions& options) {
    const int count = options.limits.max_connections;
    http::ConnectionLimits limits{.max_count = count, .max_entering = 16 + count / 16};
    // Where the gateway asks for tokens, a quarter of the places is kept for those who show one,
    // and a stranger's address gets a quarter. Where it asks for none, nobody is known, and all may
    // come through one proxy.
    const bool asks_token = !options.access.token.empty() || options.access.has_user_tokens;
    limits.max_strangers = asks_token ? count - count / 4 : count;
    limits.max_of_address = std::max(asks_token ? count / 4 : count - count / 4, 1);
    return limits;
  }

  // The connections of a proxy are those of many callers, so each counts by itself.
  std::string AddressOf(const http::PeerStream& stream) {
    const std::string address = stream.RemoteAddress();
    return parts_.proxies.Contains(address) ? absl::StrCat("proxy ", next_proxied_++)
                                            : http::PeerKey(address);
  }

  void Serve(const std::shared_ptr<http::PeerStream>& stream) {
    std::shared_ptr<http::Connections::Lease> lease = connections_.TryAdd(AddressOf(*stream));
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
  KnownTokens tokens_;
  http::Connections connections_;
  std::int64_t next_proxied_ = 0;  // for the acceptor alone
  CoordinatorClient client_;
  GatewayParts parts_;
  Api api_;
  bool has_tls_ = false;
  rpc::CertificateWatch certificate_;
  std::unique_ptr<http::PeerListener> listener_;  // ends first: its threads use the parts
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
