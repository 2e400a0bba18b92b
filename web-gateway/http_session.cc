// One connection of HTTP/1.1. Requests are answered one after the other:
//
//   state     under way                                  ends by
//   reading   the header of the next request             the header, an error, a time-out
//   taking    its body, if the caller may ask and        the body, an error, a time-out
//             finds a place (core/http/connections.h)
//   working   the Api answers; the socket is watched     the answer, or the client leaves
//   writing   the answer, piece by piece                 the last piece, a time-out of one piece
//
// A WebSocket's request ends the session: the connection continues as a WebSocket. All functions
// run on the connection's strand, except the Api's answer, which is posted to it.

#include "web-gateway/http_session.h"

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

#include "core/base/log.h"
#include "core/base/monotonic_time.h"
#include "core/base/retry_delay.h"
#include "core/base/status_macros.h"
#include "core/base/trace_context.h"
#include "core/base/version.h"
#include "core/http/peer_address.h"
#include "core/http/request_rules.h"

namespace isoscope::gateway {
namespace {

// The rest of a refused request is read for this long.
constexpr absl::Duration kDrainTime = absl::Seconds(1);

class HttpSession : public std::enable_shared_from_this<HttpSession> {
 public:
  HttpSession(std::shared_ptr<http::PeerStream> stream, GatewayParts* parts,
              std::shared_ptr<http::Connections::Lease> lease)
      : parts_(parts), lease_(std::move(lease)), stream_(std::move(stream)) {}

  void Run() {
    stream_->Post([self = shared_from_this()] {
      self->lease_->SetCloser([weak = self->weak_from_this()](bool at_once) {
        if (const std::shared_ptr<HttpSession> session = weak.lock()) {
          session->stream_->Post([session, at_once] { session->End(at_once); });
        }
      });
      self->Begin();
    });
  }

 private:
  // Ends the session when the gateway shuts down, or when another connection needs its place.
  void End(bool at_once) {
    is_ending_ = true;
    is_shutting_down_ = true;
    if (at_once && cancellation_ != nullptr) {
      cancellation_->Cancel();
    }
    if ((at_once || is_reading_) && !is_upgraded_) {
      stream_->CloseSocket();
    }
  }

  void Begin() {
    if (!stream_->has_tls()) {
      Read(parts_->limits.request_timeout);
      return;
    }
    is_reading_ = true;
    stream_->Handshake(parts_->limits.request_timeout, [self = shared_from_this()](bool is_ok) {
      if (is_ok) {
        self->Read(self->parts_->limits.request_timeout);
      } else {
        self->Close();  // the client does not use TLS, or does not know our authority
      }
    });
  }

  void Read(absl::Duration idle_timeout) {
    if (is_ending_) {
      Close();
      return;
    }
    is_reading_ = true;
    stream_->ReadHeader(
        idle_timeout, parts_->limits.request_timeout,
        [self = shared_from_this()](http::ReadError error, const std::string& message) {
          self->OnHeader(error, message);
        });
  }

  void OnHeader(http::ReadError error, const std::string& message) {
    is_reading_ = false;
    started_ = base::MonotonicNow();
    origin_ = Field("Origin");
    IdentifyRequest();
    is_head_ = request().method == "HEAD";
    if (error != http::ReadError::kNone) {
      OnReadError(error, message);
      return;
    }
    // An answer that comes before the body ends the connection.
    has_unread_bytes_ = request().has_body;
    is_ending_ = is_ending_ || !request().keeps_alive || request().has_body;
    if (const std::optional<http::Refusal> refusal = http::CheckRequest(request())) {
      is_ending_ = true;
      WriteResponse(ErrorResponse(absl::InvalidArgumentError(refusal->reason), refusal->status));
    } else if (request().asks_websocket) {
      Upgrade();
    } else if (request().method == "OPTIONS") {
      OnOptions();
    } else {
      OnRequest();
    }
  }

  // A client that has left gets no answer; one that did not send HTTP gets an error.
  void OnReadError(http::ReadError error, const std::string& message) {
    if (error == http::ReadError::kEnd) {
      Close();
      return;
    }
    is_ending_ = true;
    has_unread_bytes_ = true;
    const int status = error == http::ReadError::kLongHeader     ? 431
                       : error == http::ReadError::kLongBody     ? 413
                       : error == http::ReadError::kWrongVersion ? 505
                                                                 : 400;
    const std::string reason =
        status == 431 ? absl::StrCat("the header is longer than ",
                                     http::PeerStream::kMaxHeaderBytes, " bytes")
        : status == 413
            ? absl::StrCat("the body is longer than ", http::PeerStream::kMaxBodyBytes, " bytes")
            : absl::StrCat("this is no HTTP/1.1: ", message);
    WriteResponse(ErrorResponse(absl::InvalidArgumentError(reason), status));
  }

  [[nodiscard]] http::PeerRequest& request() const { return *stream_->request(); }
  [[nodiscard]] std::string Field(absl::string_view name) const {
    return std::string(request().Field(name));
  }

  // W3C Trace Context: the client's identity, or a new one.
  void IdentifyRequest() {
    identity_ = request().CountFields("traceparent") == 1
                    ? base::TraceContext::ParseOrRandom(request().Field("traceparent"))
                    : base::TraceContext::Random();
  }

  // Checks access. Returns the target without its token, and keeps the token for the coordinator.
  absl::StatusOr<Target> Admit() {
    user_token_.clear();
    is_allowed_page_ = false;
    ISOSCOPE_ASSIGN_OR_RETURN(Target target, ParseTarget(http::WithoutHost(request().target)));
    const std::string token = target.TakeParameter("token");
    const std::string host = http::HostOf(request());
    const std::string referer = Field("Referer");
    is_allowed_page_ = parts_->access.IsAllowedOrigin(origin_) ||
                       (origin_.empty() && parts_->access.IsAllowedReferer(referer));
    if (target.segments.empty() || target.segments[0] != "v1") {
      ISOSCOPE_RETURN_IF_ERROR(parts_->access.CheckSource(origin_, host));
      return target;
    }
    const std::string fetch_site = Field("Sec-Fetch-Site");
    ISOSCOPE_RETURN_IF_ERROR(parts_->access.CheckDataSource(
        {.origin = origin_, .host = host, .fetch_site = fetch_site, .referer = referer}));
    const std::string authorization = Authorization();
    ISOSCOPE_RETURN_IF_ERROR(parts_->access.CheckToken(token, authorization));
    ISOSCOPE_ASSIGN_OR_RETURN(user_token_, parts_->access.UserToken(token, authorization));
    return target;
  }

  // Returns "Bearer TOKEN": the header, or the token in the protocols of a WebSocket.
  [[nodiscard]] std::string Authorization() const {
    std::string token = TokenOfProtocols(request().List("Sec-WebSocket-Protocol"));
    return token.empty() ? Field("Authorization") : absl::StrCat("Bearer ", token);
  }

  // The address that counts for limits.
  std::string CallerAddress() {
    return http::PeerKey(
        parts_->proxies.CallerOf(stream_->RemoteAddress(), request().List("X-Forwarded-For")));
  }

  // Identifies the caller, for limits by user: by token, else by address.
  std::string Caller() {
    return user_token_.empty() ? absl::StrCat("address ", CallerAddress())
                               : absl::StrCat("token ", user_token_);
  }

  [[nodiscard]] http::Caller KindOf(const Target& target) const {
    if (target.segments == std::vector<std::string>{"healthz"}) {
      return http::Caller::kHealth;
    }
    const bool is_known = target.segments.empty() || target.segments[0] != "v1"
                              ? false
                              : parts_->access.has_token() || parts_->tokens->Knows(user_token_);
    return is_known ? http::Caller::kKnown : http::Caller::kStranger;
  }

  // Takes a place for work. False: the answer says why there is none, or the connection was
  // dropped.
  bool TakePlace(const Target& target) {
    const http::Placement placement = lease_->BeginWork(KindOf(target), CallerAddress());
    if (placement == http::Placement::kTaken) {
      return true;
    }
    if (placement == http::Placement::kDropped) {
      Close();
      return false;
    }
    parts_->metrics->refused.Add();
    is_ending_ = true;
    const bool is_of_address = placement == http::Placement::kAddressFull;
    WriteResponse(ErrorResponse(base::WithRetryDelay(
        is_of_address
            ? absl::ResourceExhaustedError(
                  "too many requests of this address are in work (--max-connections): ask "
                  "again later")
            : absl::UnavailableError(
                  "too many connections are at work (--max-connections): ask again later"),
        absl::Seconds(1))));
    return false;
  }

  void OnRequest() {
    absl::StatusOr<Target> target = Admit();
    if (!target.ok()) {
      WriteResponse(ErrorResponse(target.status()));
      return;
    }
    if (*target == InteractTarget()) {
      WriteResponse(ErrorResponse(
          absl::FailedPreconditionError("/v1/interact is a WebSocket: open it as one"), 426));
      return;
    }
    if (!TakePlace(*target)) {
      return;
    }
    if (!request().has_body) {
      Answer(*std::move(target));
      return;
    }
    if (KindOf(*target) == http::Caller::kHealth) {  // its body tells nothing, and may never come
      is_ending_ = true;
      Answer(*std::move(target));
      return;
    }
    const auto read = [self = shared_from_this(), target = *std::move(target)](bool is_ok) {
      if (is_ok) {
        self->ReadBody(target);
      } else {
        self->Close();
      }
    };
    if (http::WaitsToContinue(request())) {
      stream_->WriteContinue(parts_->limits.write_timeout, read);
    } else {
      read(true);
    }
  }

  void ReadBody(Target target) {
    stream_->ReadBody(parts_->limits.request_timeout,
                      [self = shared_from_this(), target = std::move(target)](
                          http::ReadError error, const std::string& message) mutable {
                        if (error != http::ReadError::kNone) {
                          self->OnReadError(error, message);
                          return;
                        }
                        self->has_unread_bytes_ = false;
                        self->is_ending_ = self->is_shutting_down_ || !self->request().keeps_alive;
                        self->Answer(std::move(target));
                      });
  }

  void Answer(Target target) {
    HttpRequest asked{.method = is_head_ ? "GET" : request().method,
                      .is_head = is_head_,
                      .target = std::move(target),
                      .token = user_token_,
                      .caller = Caller(),
                      .if_none_match = request().List("If-None-Match"),
                      .accept_encoding = request().List("Accept-Encoding"),
                      .body = std::move(request().body)};
    cancellation_ = std::make_shared<RequestScope>(identity_);
    stream_->WatchPeer([cancellation = cancellation_] { cancellation->Cancel(); });
    parts_->api->Answer(std::move(asked), cancellation_,
                        [self = shared_from_this()](HttpResponse response) {
                          self->stream_->Post([self, response = std::move(response)]() mutable {
                            self->OnAnswer(std::move(response));
                          });
                        });
  }

  void OnAnswer(HttpResponse response) {
    cancellation_ = nullptr;
    stream_->StopWatch();
    if (!user_token_.empty() && (response.status == 200 || response.status == 304)) {
      parts_->tokens->Learn(user_token_);
    }
    WriteResponse(std::move(response));
  }

  // A browser asks which requests a page of another origin may send; others ask for methods.
  void OnOptions() {
    http::PeerAnswer answer{.status = 204, .fields = MakeFields()};
    if (parts_->access.IsAllowedOrigin(origin_)) {
      http::SetField("Access-Control-Allow-Methods", "GET, HEAD, POST", &answer.fields);
      http::SetField("Access-Control-Allow-Headers",
                     "Authorization, Content-Type, If-None-Match, traceparent", &answer.fields);
      http::SetField("Access-Control-Max-Age", "600", &answer.fields);
    } else {
      http::SetField("Allow", "GET, HEAD, POST, OPTIONS", &answer.fields);
    }
    Write(std::move(answer), /*hold=*/nullptr);
  }

  void Upgrade() {
    is_ending_ = true;  // an error ends the connection
    absl::StatusOr<Target> target = Admit();
    if (!target.ok()) {
      WriteResponse(ErrorResponse(target.status()));
    } else if (*target != InteractTarget()) {
      WriteResponse(ErrorResponse(absl::NotFoundError(
          "there is no WebSocket at this address: it is /v1/interact, without parameters but "
          "token")));
    } else if (TakePlace(*target)) {
      is_upgraded_ = true;
      ServeWebSocket(stream_, user_token_, identity_, parts_, std::move(lease_));
    }
  }

  static const Target& InteractTarget() {
    static const Target target{.segments = {"v1", "interact"}};
    return target;
  }

  [[nodiscard]] http::PeerFields MakeFields() const {
    http::PeerFields fields;
    fields.emplace_back("Server", absl::StrCat("isoscope-gateway/", base::Version()));
    fields.emplace_back("X-Request-Id", identity_.request_id());
    fields.emplace_back("traceresponse", identity_.MakeTraceparent());
    fields.emplace_back("X-Content-Type-Options", "nosniff");
    fields.emplace_back("Referrer-Policy", "no-referrer");  // addresses may hold the token
    fields.emplace_back("Cross-Origin-Resource-Policy",
                        is_allowed_page_ ? "cross-origin" : "same-origin");
    if (!origin_.empty() && parts_->access.IsAllowedOrigin(origin_)) {
      fields.emplace_back("Access-Control-Allow-Origin", origin_);
      fields.emplace_back("Access-Control-Expose-Headers",
                          "ETag, X-Isoscope-Extent, X-Isoscope-Camera, X-Isoscope-Selection, "
                          "X-Isoscope-Time, X-Isoscope-Color-Ranges, X-Isoscope-Level, "
                          "X-Request-Id");
      fields.emplace_back("Vary", "Origin");
    }
    if (is_ending_) {
      fields.emplace_back("Connection", "close");
    }
    return fields;
  }

  void WriteResponse(HttpResponse response) {
    parts_->metrics->CountRequest(response.status, base::MonotonicNow() - started_);
    base::LogDebug("http_request",
                   {{"request", identity_.request_id()},
                    {"method", request().method},
                    {"status", response.status},
                    {"duration_ms", base::LogMilliseconds(base::MonotonicNow() - started_)}});
    http::PeerAnswer answer{.status = response.status};
    if (!response.file_path.empty()) {
      absl::StatusOr<http::AnswerFile> file = http::AnswerFile::Open(response.file_path);
      RemoveTemporaryFile(response.file_path);
      if (!file.ok()) {
        WriteResponse(ErrorResponse(absl::InternalError(
            absl::StrCat("the file of the answer can't be read: ", file.status().message()))));
        return;
      }
      answer.file = *std::move(file);
    }
    answer.fields = MakeFields();
    for (const auto& [name, value] : response.headers) {
      http::SetField(name, value, &answer.fields);
    }
    if (!response.content_type.empty()) {
      http::SetField("Content-Type", response.content_type, &answer.fields);
    }
    const bool has_body = answer.file.is_open() || (!is_head_ && response.status != 304);
    if (has_body || (response.status != 304 && !response.has_unknown_length)) {
      http::SetField("Content-Length",
                     answer.file.is_open() ? absl::StrCat(answer.file.size())
                                           : absl::StrCat(response.body.size()),
                     &answer.fields);
    }
    if (has_body && !answer.file.is_open()) {
      answer.body = std::move(response.body);
    }
    Write(std::move(answer), std::move(response.hold));
  }

  // `hold` lives until the answer is sent.
  void Write(http::PeerAnswer answer, std::shared_ptr<void> hold) {
    stream_->WriteAnswer(std::move(answer),
                         {.piece_timeout = parts_->limits.write_timeout,
                          .min_bytes_per_second = parts_->limits.min_bytes_per_second},
                         [self = shared_from_this(), hold = std::move(hold)](bool is_ok) {
                           if (is_ok && !self->is_ending_) {
                             self->lease_->EndWork();
                             self->Read(self->parts_->limits.idle_timeout);
                           } else {
                             self->Close();
                           }
                         });
  }

  // Tells the peer that no more data comes; the socket closes with this session.
  void Close() {
    stream_->End(has_unread_bytes_, kDrainTime,
                 [self = shared_from_this()] { self->lease_ = nullptr; });
  }

  GatewayParts* const parts_;
  std::shared_ptr<http::Connections::Lease> lease_;
  const std::shared_ptr<http::PeerStream> stream_;
  std::shared_ptr<RequestScope> cancellation_;  // of the answer in work
  std::string origin_;
  std::string user_token_;                                      // of the request in work
  base::TraceContext identity_ = base::TraceContext::Random();  // of the request in work
  base::MonotonicTime started_ = base::MonotonicNow();
  bool is_head_ = false;
  bool is_allowed_page_ = false;  // the request comes from a page of an allowed origin
  bool is_reading_ = false;
  bool has_unread_bytes_ = false;
  bool is_upgraded_ = false;  // stream_ belongs to a WebSocket
  bool is_ending_ = false;    // no further request is read
  bool is_shutting_down_ = false;
};

}  // namespace

void ServeHttp(std::shared_ptr<http::PeerStream> stream, GatewayParts* parts,
               std::shared_ptr<http::Connections::Lease> lease) {
  std::make_shared<HttpSession>(std::move(stream), parts, std::move(lease))->Run();
}

}  // namespace isoscope::gateway
