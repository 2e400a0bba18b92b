// Each step is an asynchronous operation that runs alone, because only those can be given a time.

#include "web-gateway/health_request.h"

#include <chrono>
#include <cstdint>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/ssl/host_name_verification.hpp>
#include <boost/asio/ssl/stream.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/http/write.hpp>

#include "core/base/status_macros.h"

namespace isoscope::gateway {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using asio::ip::tcp;
using boost::system::error_code;

constexpr std::uint64_t kMaxBodyBytes = 64 * 1024;

class HealthClient {
 public:
  explicit HealthClient(const HealthRequest& request)
      : request_(request), end_(absl::ToChronoTime(absl::Now() + request.timeout)) {}

  absl::Status Ask() {
    const std::size_t colon = request_.address.rfind(':');
    if (colon == std::string::npos) {
      return absl::InvalidArgumentError(absl::StrCat("'", request_.address, "' is not HOST:PORT"));
    }
    std::string host = request_.address.substr(0, colon);
    if (host.size() > 2 && host.front() == '[') {
      host = host.substr(1, host.size() - 2);
    }
    error_code error;
    const auto endpoints =
        tcp::resolver(io_).resolve(host, request_.address.substr(colon + 1), error);
    ISOSCOPE_RETURN_IF_ERROR(ToStatus("the name is not known", error));
    beast::tcp_stream stream(io_);
    ISOSCOPE_RETURN_IF_ERROR(
        ToStatus("can't connect", Run([&](auto done) { stream.async_connect(endpoints, done); })));
    if (!request_.has_tls) {
      return Exchange(&stream);
    }
    asio::ssl::context context(asio::ssl::context::tls_client);
    if (request_.ca_file.empty()) {
      context.set_verify_mode(asio::ssl::verify_none);
    } else {
      context.load_verify_file(request_.ca_file, error);
      ISOSCOPE_RETURN_IF_ERROR(ToStatus(request_.ca_file, error));
      context.set_verify_mode(asio::ssl::verify_peer);
      context.set_verify_callback(asio::ssl::host_name_verification(host));
    }
    asio::ssl::stream<beast::tcp_stream&> secure(stream, context);
    ISOSCOPE_RETURN_IF_ERROR(ToStatus(
        "no TLS",
        Run([&](auto done) { secure.async_handshake(asio::ssl::stream_base::client, done); })));
    return Exchange(&secure);
  }

 private:
  // Starts an operation and waits for its end, or for the end of the time.
  template <typename Start>
  error_code Run(const Start& start) {
    error_code result = asio::error::timed_out;
    start([&result](error_code error, const auto&... /*more*/) { result = error; });
    io_.restart();
    io_.run_until(end_);
    return result;
  }

  template <typename Stream>
  absl::Status Exchange(Stream* stream) {
    http::request<http::empty_body> request(http::verb::get, "/healthz", 11);
    // A gateway on the loopback address answers to names of that only.
    request.set(http::field::host, "localhost");
    request.keep_alive(false);
    ISOSCOPE_RETURN_IF_ERROR(
        ToStatus("can't ask", Run([&](auto done) { http::async_write(*stream, request, done); })));
    beast::flat_buffer buffer;
    http::response_parser<http::string_body> response;
    response.body_limit(kMaxBodyBytes);
    ISOSCOPE_RETURN_IF_ERROR(ToStatus(
        "no answer", Run([&](auto done) { http::async_read(*stream, buffer, response, done); })));
    if (response.get().result_int() == 200) {
      return absl::OkStatus();
    }
    return absl::UnavailableError(absl::StrCat("the gateway answers ", response.get().result_int(),
                                               ": ",
                                               absl::StripAsciiWhitespace(response.get().body())));
  }

  static absl::Status ToStatus(absl::string_view step, const error_code& error) {
    return error ? absl::UnavailableError(absl::StrCat(step, ": ", error.message()))
                 : absl::OkStatus();
  }

  const HealthRequest request_;
  const std::chrono::system_clock::time_point end_;
  asio::io_context io_;
};

}  // namespace

absl::Status AskHealth(const HealthRequest& request) { return HealthClient(request).Ask(); }

}  // namespace isoscope::gateway
