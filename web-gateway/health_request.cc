// One GET /healthz, with one time limit for all of it:
//
//   resolve the name -> connect, address by address -> TLS -> write -> read the whole answer
//
// Each step is an asynchronous operation. Run starts it, and runs the context until it ends or the
// time is over. So no thread waits without a limit.

#include "web-gateway/health_request.h"

#include <chrono>
#include <functional>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include <boost/asio/buffer.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/ssl/host_name_verification.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/string_body.hpp>

#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/http/http_reader.h"
#include "core/http/transport.h"

namespace isoscope::gateway {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace beast_http = beast::http;
using asio::ip::tcp;
using boost::system::error_code;

constexpr std::uint64_t kMaxReplyBytes = 64 * 1024;

absl::Status ToStatus(absl::string_view step, const error_code& error) {
  return error ? absl::UnavailableError(absl::StrCat(step, ": ", error.message()))
               : absl::OkStatus();
}

// Each step is an asynchronous operation that runs alone, because only those can have a time limit.
class Questioner {
 public:
  // request: outlives it. `host`: without brackets.
  Questioner(const HealthRequest& request, std::string host, std::string port)
      : request_(request),
        host_(std::move(host)),
        port_(std::move(port)),
        end_((base::MonotonicNow() + request.timeout).ToChrono()),
        context_(asio::ssl::context::tls_client),
        transport_(io_) {}

  absl::Status Ask() {
    error_code error;
    const auto found = tcp::resolver(io_).resolve(host_, port_, error);
    ISOSCOPE_RETURN_IF_ERROR(ToStatus("the name is not known", error));
    ISOSCOPE_RETURN_IF_ERROR(ToStatus("can't connect", Connect(found)));
    if (request_.has_tls) {
      ISOSCOPE_RETURN_IF_ERROR(SetUpTls());
      ISOSCOPE_RETURN_IF_ERROR(ToStatus(
          "no TLS", Run([&](http::ErrorDone done) {
            transport_.Handshake(&context_, asio::ssl::stream_base::client, std::move(done));
          })));
    }
    // A gateway on the loopback address accepts only names of that address.
    constexpr absl::string_view kRequest =
        "GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
    for (asio::const_buffer unsent = asio::buffer(kRequest.data(), kRequest.size());
         unsent.size() > 0;) {
      ISOSCOPE_RETURN_IF_ERROR(ToStatus(
          "can't ask", Run([&](const http::ErrorDone& done) {
            transport_.Write({unsent}, [&unsent, done](error_code failed, std::size_t size) {
              unsent += size;
              done(failed);
            });
          })));
    }
    beast::flat_buffer buffer;
    beast_http::response_parser<beast_http::string_body> reply;
    reply.body_limit(kMaxReplyBytes);
    reply.eager(true);
    ISOSCOPE_RETURN_IF_ERROR(ToStatus("no answer", Run([&](const http::ErrorDone& done) {
                                        http::ReadMessagePart<false>(&transport_, &buffer, &reply,
                                                                     http::MessagePart::kWhole,
                                                                     done);
                                      })));
    const unsigned status = reply.get().result_int();
    return status == 200 ? absl::OkStatus()
                         : absl::UnavailableError(
                               absl::StrCat("the gateway answers ", status, ": ",
                                            absl::StripAsciiWhitespace(reply.get().body())));
  }

 private:
  // Starts an operation and waits for its end, or for its time limit.
  error_code Run(const std::function<void(http::ErrorDone)>& start) {
    error_code result = asio::error::timed_out;
    start([&result](error_code error) { result = error; });
    io_.restart();
    io_.run_until(end_);
    return result;
  }

  // Tries the addresses in order.
  error_code Connect(const tcp::resolver::results_type& found) {
    error_code error = asio::error::not_found;
    for (const auto& entry : found) {
      error = Run([&](http::ErrorDone done) {
        transport_.next_layer().async_connect(entry.endpoint(), std::move(done));
      });
      if (!error || error == asio::error::timed_out) {
        break;
      }
      error_code ignored;
      transport_.socket().close(ignored);
    }
    return error;
  }

  absl::Status SetUpTls() {
    if (request_.ca_file.empty()) {
      context_.set_verify_mode(asio::ssl::verify_none);
      return absl::OkStatus();
    }
    error_code error;
    context_.load_verify_file(request_.ca_file, error);
    ISOSCOPE_RETURN_IF_ERROR(ToStatus(request_.ca_file, error));
    context_.set_verify_mode(asio::ssl::verify_peer);
    context_.set_verify_callback(asio::ssl::host_name_verification(host_));
    return absl::OkStatus();
  }

  const HealthRequest& request_;
  const std::string host_;
  const std::string port_;
  const std::chrono::steady_clock::time_point end_;
  asio::io_context io_;
  asio::ssl::context context_;
  http::Transport transport_;
};

}  // namespace

absl::Status AskHealth(const HealthRequest& request) {
  const std::size_t colon = request.address.rfind(':');
  if (colon == std::string::npos) {
    return absl::InvalidArgumentError(absl::StrCat("'", request.address, "' is not HOST:PORT"));
  }
  std::string host = request.address.substr(0, colon);
  if (host.size() > 2 && host.front() == '[') {
    host = host.substr(1, host.size() - 2);
  }
  return Questioner(request, std::move(host), request.address.substr(colon + 1)).Ask();
}

}  // namespace isoscope::gateway
