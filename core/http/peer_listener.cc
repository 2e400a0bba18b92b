#include "core/http/peer_listener.h"

#include <chrono>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/strand.hpp>

#include "core/base/log.h"
#include "core/base/monotonic_time.h"
#include "core/http/transport.h"

namespace isoscope::http {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using boost::system::error_code;

// The pause after an error of accept, such as too many open files.
constexpr std::chrono::milliseconds kAcceptPause{100};

class PeerListenerImpl final : public PeerListener {
 public:
  PeerListenerImpl()
      : work_(asio::make_work_guard(io_)),
        acceptor_(asio::make_strand(io_)),
        timer_(acceptor_.get_executor()) {}
  ~PeerListenerImpl() override {
    work_.reset();
    io_.stop();
    for (std::thread& thread : threads_) {
      thread.join();
    }
  }

  absl::Status Listen(const std::string& host, const std::string& port, const std::string& address,
                      std::unique_ptr<TlsContext> tls, int thread_count, Serve serve) override {
    tls_ = std::move(tls);
    serve_ = std::move(serve);
    const auto failed = [&](absl::string_view step, const error_code& error) {
      return absl::UnavailableError(
          absl::StrCat("can't listen on \"", address, "\": ", step, ": ", error.message()));
    };
    error_code error;
    tcp::resolver resolver(io_);
    const auto found = resolver.resolve(host, port, tcp::resolver::passive, error);
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
    for (int i = 0; i < thread_count; ++i) {
      threads_.emplace_back([this] { io_.run(); });
    }
    return absl::OkStatus();
  }

  [[nodiscard]] int port() const override { return port_; }

  void Close() override {
    asio::post(acceptor_.get_executor(), [this] {
      error_code ignored;
      acceptor_.close(ignored);
      timer_.cancel();
    });
  }

 private:
  void Accept() {
    accepted_ = std::make_unique<tcp::socket>(asio::make_strand(io_));
    acceptor_.async_accept(*accepted_, ErrorDone([this](error_code error) {
      if (!acceptor_.is_open()) {
        return;
      }
      if (error) {
        if (!std::exchange(is_failing_, true)) {
          base::LogWarning("accept_failed", {{"error", error.message()}});
        }
        timer_.expires_after(kAcceptPause);
        timer_.async_wait(ErrorDone([this](error_code waited) {
          if (!waited && acceptor_.is_open()) {
            Accept();
          }
        }));
        return;
      }
      if (std::exchange(is_failing_, false)) {
        base::LogInfo("accept_works_again");
      }
      error_code ignored;
      accepted_->set_option(tcp::no_delay(true), ignored);
      serve_(PeerStream::Make(std::make_unique<Transport>(std::move(*accepted_)),
                              tls_ == nullptr ? nullptr : tls_->Get(base::MonotonicNow())));
      Accept();
    }));
  }

  std::unique_ptr<TlsContext> tls_;  // null: http. Used on the acceptor's strand
  Serve serve_;
  asio::io_context io_;
  asio::executor_work_guard<asio::io_context::executor_type> work_;
  tcp::acceptor acceptor_;
  asio::steady_timer timer_;
  std::unique_ptr<tcp::socket> accepted_;
  int port_ = 0;
  bool is_failing_ = false;  // the last accept; a line of the log is for the change
  std::vector<std::thread> threads_;
};

}  // namespace

std::unique_ptr<PeerListener> PeerListener::Make() { return std::make_unique<PeerListenerImpl>(); }

}  // namespace isoscope::http
