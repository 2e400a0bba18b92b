// Owns the threads, the listening socket and all parts. The order of the end matters: connections
// first, then calls to the coordinator, whose callbacks still post to the threads, then the
// threads.

#include "web-gateway/gateway_server.h"

#include <unistd.h>

#include <array>
#include <chrono>
#include <thread>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/strand.hpp>

#include "core/base/log.h"
#include "core/base/status_macros.h"
#include "core/rpc/host_port.h"
#include "web-gateway/http_session.h"
#include "web-gateway/tls_context.h"
#include "web-gateway/url.h"

namespace isoscope::gateway {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using boost::system::error_code;

// How long connections may take to close once they are told to.
constexpr absl::Duration kCloseGrace = absl::Seconds(5);
// After an error of accept, such as too many open files.
constexpr std::chrono::milliseconds kAcceptPause{100};

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
        work_(asio::make_work_guard(io_)),
        acceptor_(asio::make_strand(io_)),
        accept_timer_(acceptor_.get_executor()) {}
  ~GatewayServerImpl() override {
    Shutdown(absl::ZeroDuration());
    client_.AwaitCalls();
    work_.reset();
    io_.stop();
    for (std::thread& thread : threads_) {
      thread.join();
    }
  }

  absl::Status Listen(const GatewayOptions& options) {
    if (!options.certificate_file.empty()) {
      ISOSCOPE_ASSIGN_OR_RETURN(tls_, TlsContext::Make(options.certificate_file, options.key_file));
    }
    // The resolver would take 99999 for another port.
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string address,
                              rpc::ParseHostPort(options.listen_address));
    const std::size_t colon = address.rfind(':');
    const auto failed = [&](absl::string_view step, const error_code& error) {
      return absl::UnavailableError(
          absl::StrCat("can't listen on \"", address, "\": ", step, ": ", error.message()));
    };
    std::string host = address.substr(0, colon);
    if (host.size() > 2 && host.front() == '[') {
      host = host.substr(1, host.size() - 2);
    }
    error_code error;
    tcp::resolver resolver(io_);
    const auto found =
        resolver.resolve(host, address.substr(colon + 1), tcp::resolver::passive, error);
    if (error || found.empty()) {
      return failed("the name is not known", error);
    }
    const tcp::endpoint endpoint = found.begin()->endpoint();
    acceptor_.open(endpoint.protocol(), error);
    if (!error) {
      acceptor_.set_option(asio::socket_base::reuse_address(true), error);
    }
    if (!error) {
      acceptor_.bind(endpoint, error);
    }
    if (!error) {
      acceptor_.listen(asio::socket_base::max_listen_connections, error);
    }
    if (error) {
      return failed("it is in use, or not an address of this machine", error);
    }
    port_ = acceptor_.local_endpoint().port();
    asio::post(acceptor_.get_executor(), [this] { Accept(); });
    for (int i = 0; i < options.thread_count; ++i) {
      threads_.emplace_back([this] { io_.run(); });
    }
    return absl::OkStatus();
  }

  [[nodiscard]] int port() const override { return port_; }

  std::vector<base::MetricFamily> CollectMetrics() override {
    return metrics_.Collect({.connections = connections_.count(),
                             .max_connections = parts_.limits.max_connections,
                             .pictures = api_.pictures_in_work(),
                             .max_pictures = parts_.limits.max_pictures});
  }

  void Shutdown(absl::Duration grace) override {
    asio::post(acceptor_.get_executor(), [this] {
      error_code ignored;
      acceptor_.close(ignored);
      accept_timer_.cancel();
    });
    connections_.Close(/*at_once=*/false);
    if (!connections_.AwaitNone(absl::Now() + grace)) {
      connections_.Close(/*at_once=*/true);
      connections_.AwaitNone(absl::Now() + kCloseGrace);
    }
  }

 private:
  static AccessOptions AccessFor(const GatewayOptions& options) {
    AccessOptions access = options.access;
    access.listens_on_loopback = IsLoopback(options.listen_address);
    return access;
  }

  void Accept() {
    acceptor_.async_accept(asio::make_strand(io_), [this](error_code error, tcp::socket socket) {
      if (!acceptor_.is_open()) {
        return;
      }
      if (error) {
        base::LogWarning("accept_failed", {{"error", error.message()}});
        accept_timer_.expires_after(kAcceptPause);
        accept_timer_.async_wait([this](error_code waited) {
          if (!waited && acceptor_.is_open()) {
            Accept();
          }
        });
        return;
      }
      Take(std::move(socket));
      Accept();
    });
  }

  void Take(tcp::socket socket) {
    error_code ignored;
    socket.set_option(tcp::no_delay(true), ignored);
    std::shared_ptr<Connections::Lease> lease = connections_.TryAdd();
    if (lease != nullptr) {
      ServeHttp(PeerStream(std::move(socket), tls_ == nullptr ? nullptr : tls_->Get(absl::Now())),
                &parts_, std::move(lease));
      return;
    }
    metrics_.refused.Add();
    if (tls_ != nullptr) {
      return;  // an answer would cost a handshake
    }
    // The buffer of a new socket has room for this.
    socket.non_blocking(true, ignored);
    socket.send(asio::buffer(kTooManyConnections.data(), kTooManyConnections.size()), 0, ignored);
    socket.shutdown(tcp::socket::shutdown_both, ignored);
  }

  GatewayMetrics metrics_;
  Connections connections_;
  CoordinatorClient client_;
  GatewayParts parts_;
  Api api_;
  std::unique_ptr<TlsContext> tls_;  // null: http. Used on the acceptor's strand
  asio::io_context io_;
  asio::executor_work_guard<asio::io_context::executor_type> work_;
  tcp::acceptor acceptor_;
  asio::steady_timer accept_timer_;
  int port_ = 0;
  std::vector<std::thread> threads_;
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
