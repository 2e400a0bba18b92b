// One connection of HTTP/1.1. Requests are answered one after the other:
//
//   state     what is under way                          ends by
//   reading   the next request's header, then its body   the request, an error, a time-out
//   working   the Api answers; the socket is watched      the answer; a client that leaves cancels
//   it writing   the answer, piece by piece                  the last piece, a time-out of one
//   piece
//
// A WebSocket's request ends the session: the connection goes on as a WebSocket.
// Everything runs on the connection's strand, but for the Api's answer, which is posted to it.

#include "web-gateway/http_session.h"

#include <poll.h>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include <boost/asio/dispatch.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/file_body.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/serializer.hpp>
#include <boost/beast/http/write.hpp>
#include <boost/beast/websocket/rfc6455.hpp>

#include "core/base/log.h"
#include "core/base/status_macros.h"
#include "core/base/trace_context.h"
#include "core/base/version.h"

namespace isoscope::gateway {
namespace {

namespace beast = boost::beast;
namespace http = beast::http;
using boost::asio::ip::tcp;
using boost::system::error_code;

constexpr std::uint32_t kMaxHeaderBytes = 16 * 1024;
constexpr std::uint64_t kMaxBodyBytes = 1024 * 1024;
// Rest of a request that was refused, so long.
constexpr absl::Duration kDrainTime = absl::Seconds(1);
// Between two looks at a TLS client that has sent something while its answer is in work.
constexpr std::chrono::milliseconds kWatchPause{200};

absl::string_view View(boost::string_view text) { return {text.data(), text.size()}; }

class HttpSession : public std::enable_shared_from_this<HttpSession> {
 public:
  HttpSession(PeerStream stream, GatewayParts* parts, std::shared_ptr<Connections::Lease> lease)
      : parts_(parts),
        lease_(std::move(lease)),
        stream_(std::move(stream)),
        watch_timer_(stream_.get_executor()) {}

  void Run() {
    boost::asio::dispatch(stream_.get_executor(), [self = shared_from_this()] {
      self->lease_->SetCloser([weak = self->weak_from_this()](bool at_once) {
        if (const std::shared_ptr<HttpSession> session = weak.lock()) {
          boost::asio::post(session->stream_.get_executor(),
                            [session, at_once] { session->End(at_once); });
        }
      });
      self->Begin();
    });
  }

 private:
  using Parser = http::request_parser<http::string_body>;

  // The gateway shuts down.
  void End(bool at_once) {
    is_ending_ = true;
    if (at_once && cancellation_ != nullptr) {
      cancellation_->Cancel();
    }
    if ((at_once || is_reading_) && !is_upgraded_) {
      stream_.next_layer().close();
    }
  }

  tcp::socket& socket() { return stream_.next_layer().socket(); }
  void ExpireAfter(absl::Duration timeout) {
    stream_.next_layer().expires_after(absl::ToChronoMilliseconds(timeout));
  }

  void Begin() {
    if (!stream_.has_tls()) {
      Read(parts_->limits.request_timeout);
      return;
    }
    ExpireAfter(parts_->limits.request_timeout);
    is_reading_ = true;
    stream_.AsyncHandshake([self = shared_from_this()](error_code error) {
      if (error) {
        self->Close();  // somebody who speaks no TLS, or does not know our authority
      } else {
        self->Read(self->parts_->limits.request_timeout);
      }
    });
  }

  void Read(absl::Duration timeout) {
    if (is_ending_) {
      Close();
      return;
    }
    parser_.emplace();
    parser_->header_limit(kMaxHeaderBytes);
    parser_->body_limit(kMaxBodyBytes);
    is_reading_ = true;
    ExpireAfter(timeout);
    http::async_read_header(
        stream_, buffer_, *parser_,
        [self = shared_from_this()](error_code error, std::size_t) { self->OnHeader(error); });
  }

  void OnHeader(error_code error) {
    if (error) {
      OnReadError(error);
      return;
    }
    if (beast::websocket::is_upgrade(parser_->get())) {
      is_reading_ = false;
      Upgrade();
      return;
    }
    ExpireAfter(parts_->limits.request_timeout);
    http::async_read(stream_, buffer_, *parser_,
                     [self = shared_from_this()](error_code body_error, std::size_t) {
                       if (body_error) {
                         self->OnReadError(body_error);
                       } else {
                         self->OnRequest();
                       }
                     });
  }

  // A client that has left gets nothing; one that sends what is no HTTP is told so.
  void OnReadError(error_code error) {
    is_reading_ = false;
    const bool is_http_error = error.category() == error_code(http::error::bad_method).category();
    if (!is_http_error || error == http::error::end_of_stream ||
        error == http::error::partial_message) {
      Close();
      return;
    }
    is_ending_ = true;
    has_unread_bytes_ = true;
    const int status = error == http::error::header_limit ? 431
                       : error == http::error::body_limit ? 413
                                                          : 400;
    const std::string reason =
        status == 431   ? absl::StrCat("the header is longer than ", kMaxHeaderBytes, " bytes")
        : status == 413 ? absl::StrCat("the body is longer than ", kMaxBodyBytes, " bytes")
                        : absl::StrCat("this is no HTTP/1.1: ", error.message());
    WriteResponse(ErrorResponse(absl::InvalidArgumentError(reason), status));
  }

  [[nodiscard]] std::string Field(http::field name) const {
    return absl::StrCat(View(parser_->get()[name]));
  }

  // W3C Trace Context: the client's identity, or a new one.
  void IdentifyRequest() {
    const auto [begin, end] = parser_->get().equal_range("traceparent");
    identity_ = begin != end && std::next(begin) == end
                    ? base::TraceContext::ParseOrRandom(View(begin->value()))
                    : base::TraceContext::Random();
  }

  // Checks who asks. Returns the target without its token, and keeps that for the coordinator.
  absl::StatusOr<Target> Admit() {
    user_token_.clear();
    is_allowed_page_ = false;
    ISOSCOPE_ASSIGN_OR_RETURN(Target target, ParseTarget(View(parser_->get().target())));
    const std::string token = target.TakeParameter("token");
    const std::string host = Field(http::field::host);
    const std::string referer = Field(http::field::referer);
    is_allowed_page_ = parts_->access.IsAllowedOrigin(origin_) ||
                       (origin_.empty() && parts_->access.IsAllowedReferer(referer));
    if (target.segments.empty() || target.segments[0] != "v1") {
      ISOSCOPE_RETURN_IF_ERROR(parts_->access.CheckSource(origin_, host));
      return target;
    }
    const std::string fetch_site = absl::StrCat(View(parser_->get()["Sec-Fetch-Site"]));
    ISOSCOPE_RETURN_IF_ERROR(parts_->access.CheckDataSource(
        {.origin = origin_, .host = host, .fetch_site = fetch_site, .referer = referer}));
    const std::string authorization = Authorization();
    ISOSCOPE_RETURN_IF_ERROR(parts_->access.CheckToken(token, authorization));
    ISOSCOPE_ASSIGN_OR_RETURN(user_token_, parts_->access.UserToken(token, authorization));
    return target;
  }

  // "Bearer TOKEN": the header, or what the protocols of a WebSocket say.
  [[nodiscard]] std::string Authorization() const {
    std::string token = TokenOfProtocols(Field(http::field::sec_websocket_protocol));
    return token.empty() ? Field(http::field::authorization) : absl::StrCat("Bearer ", token);
  }

  // Whose request it is, where users share the gateway: by token, else by address.
  std::string Caller() {
    error_code ignored;
    return user_token_.empty()
               ? absl::StrCat("address ", socket().remote_endpoint(ignored).address().to_string())
               : absl::StrCat("token ", user_token_);
  }

  void OnRequest() {
    is_reading_ = false;
    started_ = absl::Now();
    origin_ = Field(http::field::origin);
    IdentifyRequest();
    const http::verb method = parser_->get().method();
    is_head_ = method == http::verb::head;
    if (!parser_->get().keep_alive()) {
      is_ending_ = true;
    }
    absl::StatusOr<Target> target = Admit();
    if (method == http::verb::options && parts_->access.IsAllowedOrigin(origin_)) {
      WritePreflight();
      return;
    }
    if (!target.ok()) {
      WriteResponse(ErrorResponse(target.status()));
      return;
    }
    if (*target == InteractTarget()) {
      WriteResponse(ErrorResponse(
          absl::FailedPreconditionError("/v1/interact is a WebSocket: open it as one"), 426));
      return;
    }
    HttpRequest request{
        .method = is_head_ ? "GET" : absl::StrCat(View(parser_->get().method_string())),
        .is_head = is_head_,
        .target = *std::move(target),
        .token = user_token_,
        .caller = Caller(),
        .if_none_match = Field(http::field::if_none_match),
        .body = std::move(parser_->get().body())};
    cancellation_ = std::make_shared<RequestScope>(identity_);
    // A client may wait for long, and says nothing meanwhile.
    stream_.next_layer().expires_never();
    WatchClient();
    parts_->api->Answer(std::move(request), cancellation_,
                        [self = shared_from_this()](HttpResponse response) {
                          boost::asio::post(self->stream_.get_executor(),
                                            [self, response = std::move(response)]() mutable {
                                              self->OnAnswer(std::move(response));
                                            });
                        });
  }

  // Cancels the work for a client that leaves before its answer.
  void WatchClient() {
    socket().async_wait(tcp::socket::wait_read, [self = shared_from_this(),
                                                 cancellation = cancellation_](error_code error) {
      if (error || cancellation != self->cancellation_) {
        return;
      }
      if (self->HasLeft()) {
        cancellation->Cancel();
      } else if (self->stream_.has_tls()) {
        self->WatchLater();
      }
    });
  }

  // A TLS client says goodbye before it leaves, which can't be told from a next request here.
  void WatchLater() {
    watch_timer_.expires_after(kWatchPause);
    watch_timer_.async_wait(
        [self = shared_from_this(), cancellation = cancellation_](error_code error) {
          if (!error && cancellation == self->cancellation_) {
            self->WatchClient();
          }
        });
  }

  bool HasLeft() {
    pollfd watched{.fd = socket().native_handle(), .events = POLLRDHUP, .revents = 0};
    return poll(&watched, 1, 0) == 1 && (watched.revents & (POLLRDHUP | POLLHUP | POLLERR)) != 0;
  }

  void OnAnswer(HttpResponse response) {
    cancellation_ = nullptr;
    error_code ignored;
    socket().cancel(ignored);  // the watch
    watch_timer_.cancel();
    WriteResponse(std::move(response));
  }

  void Upgrade() {
    origin_ = Field(http::field::origin);
    IdentifyRequest();
    is_ending_ = true;  // an error ends the connection
    absl::StatusOr<Target> target = Admit();
    if (!target.ok()) {
      WriteResponse(ErrorResponse(target.status()));
    } else if (*target != InteractTarget()) {
      WriteResponse(ErrorResponse(absl::NotFoundError(
          "there is no WebSocket at this address: it is /v1/interact, without parameters but "
          "token")));
    } else {
      is_upgraded_ = true;
      ServeWebSocket(std::move(stream_), user_token_, parser_->release(), identity_, parts_,
                     std::move(lease_));
    }
  }

  static const Target& InteractTarget() {
    static const Target target{.segments = {"v1", "interact"}};
    return target;
  }

  template <typename Body>
  http::response<Body> MakeHeader(int status) const {
    http::response<Body> header;
    header.version(11);
    header.result(static_cast<unsigned>(status));
    header.set(http::field::server, absl::StrCat("isoscope-gateway/", base::Version()));
    header.set("X-Request-Id", identity_.request_id());
    header.set("traceresponse", identity_.MakeTraceparent());
    header.set("X-Content-Type-Options", "nosniff");
    header.set("Referrer-Policy", "no-referrer");  // addresses may hold the token
    header.set("Cross-Origin-Resource-Policy", is_allowed_page_ ? "cross-origin" : "same-origin");
    if (!origin_.empty() && parts_->access.IsAllowedOrigin(origin_)) {
      header.set(http::field::access_control_allow_origin, origin_);
      header.set(http::field::access_control_expose_headers,
                 "ETag, X-Isoscope-Extent, X-Isoscope-Camera, X-Request-Id");
      header.set(http::field::vary, "Origin");
    }
    header.keep_alive(!is_ending_);
    return header;
  }

  void WritePreflight() {
    auto response = MakeHeader<http::empty_body>(204);
    response.set(http::field::access_control_allow_methods, "GET, POST");
    response.set(http::field::access_control_allow_headers,
                 "Authorization, Content-Type, If-None-Match, traceparent");
    response.set(http::field::access_control_max_age, "600");
    Write(std::move(response));
  }

  void WriteResponse(HttpResponse response) {
    parts_->metrics->CountRequest(response.status, absl::Now() - started_);
    base::LogDebug("http_request",
                   {{"request", identity_.request_id()},
                    {"method", absl::StrCat(View(parser_->get().method_string()))},
                    {"status", response.status},
                    {"duration_ms", base::LogMilliseconds(absl::Now() - started_)}});
    const auto fill = [&](auto* message) {
      for (const auto& [name, value] : response.headers) {
        message->set(name, value);
      }
      if (!response.content_type.empty()) {
        message->set(http::field::content_type, response.content_type);
      }
    };
    if (!response.file_path.empty()) {
      WriteFile(response, fill);
    } else if (is_head_ || response.status == 304) {
      auto message = MakeHeader<http::empty_body>(response.status);
      fill(&message);
      if (response.status != 304 && !response.has_unknown_length) {
        message.content_length(response.body.size());
      }
      Write(std::move(message));
    } else {
      auto message = MakeHeader<http::string_body>(response.status);
      fill(&message);
      message.body() = std::move(response.body);
      message.prepare_payload();
      Write(std::move(message));
    }
  }

  template <typename Fill>
  void WriteFile(const HttpResponse& response, const Fill& fill) {
    auto message = MakeHeader<http::file_body>(response.status);
    error_code error;
    message.body().open(response.file_path.c_str(), beast::file_mode::scan, error);
    RemoveTemporaryFile(response.file_path);
    if (error) {
      WriteResponse(ErrorResponse(absl::InternalError(
          absl::StrCat("the file of the answer can't be read: ", error.message()))));
      return;
    }
    fill(&message);
    message.prepare_payload();
    Write(std::move(message), response.hold);
  }

  template <typename Body>
  struct Outgoing {
    Outgoing(http::response<Body> response, std::shared_ptr<void> held)
        : hold(std::move(held)), message(std::move(response)), serializer(message) {}
    const std::shared_ptr<void> hold;
    http::response<Body> message;
    http::response_serializer<Body> serializer;
  };

  template <typename Body>
  void Write(http::response<Body> response, std::shared_ptr<void> hold = nullptr) {
    WriteNext(std::make_shared<Outgoing<Body>>(std::move(response), std::move(hold)));
  }

  // Each piece has its own time-out: a long answer may take long, a reader that stalls may not.
  template <typename Body>
  void WriteNext(std::shared_ptr<Outgoing<Body>> outgoing) {
    ExpireAfter(parts_->limits.write_timeout);
    http::async_write_some(stream_, outgoing->serializer,
                           [self = shared_from_this(), outgoing](error_code error, std::size_t) {
                             if (error) {
                               self->Close();
                             } else if (!outgoing->serializer.is_done()) {
                               self->WriteNext(outgoing);
                             } else if (!outgoing->message.keep_alive() || self->is_ending_) {
                               self->Close();
                             } else {
                               self->Read(self->parts_->limits.idle_timeout);
                             }
                           });
  }

  // Tells the peer that no more comes; the socket closes with this session.
  void Close() {
    if (stream_.has_tls() && !has_unread_bytes_) {
      ExpireAfter(kDrainTime);
      stream_.AsyncShutdown([self = shared_from_this()](error_code) { self->lease_ = nullptr; });
      return;
    }
    error_code ignored;
    socket().shutdown(tcp::socket::shutdown_send, ignored);
    if (has_unread_bytes_) {
      ExpireAfter(kDrainTime);
      Drain();
    } else {
      lease_ = nullptr;
    }
  }

  // Reads on for a moment: a socket that is closed with unread bytes takes the answer back.
  void Drain() {
    buffer_.clear();
    constexpr std::size_t kPieceBytes = 4096;
    stream_.async_read_some(buffer_.prepare(kPieceBytes),
                            [self = shared_from_this()](error_code error, std::size_t) {
                              if (error) {
                                self->lease_ = nullptr;
                              } else {
                                self->Drain();
                              }
                            });
  }

  GatewayParts* const parts_;
  std::shared_ptr<Connections::Lease> lease_;
  PeerStream stream_;
  boost::asio::steady_timer watch_timer_;
  beast::flat_buffer buffer_{kMaxHeaderBytes + kMaxBodyBytes};
  std::optional<Parser> parser_;
  std::shared_ptr<RequestScope> cancellation_;  // of the answer in work
  std::string origin_;
  std::string user_token_;                                      // of the request in work
  base::TraceContext identity_ = base::TraceContext::Random();  // of the request in work
  absl::Time started_ = absl::Now();
  bool is_head_ = false;
  bool is_allowed_page_ = false;  // the request comes from a page of an allowed origin
  bool is_reading_ = false;
  bool has_unread_bytes_ = false;
  bool is_upgraded_ = false;  // stream_ belongs to a WebSocket
  bool is_ending_ = false;    // no further request is read
};

}  // namespace

void ServeHttp(PeerStream stream, GatewayParts* parts, std::shared_ptr<Connections::Lease> lease) {
  std::make_shared<HttpSession>(std::move(stream), parts, std::move(lease))->Run();
}

}  // namespace isoscope::gateway
