// One connection of HTTP/1.1. Requests are answered one after the other:
//
//   state     under way                                  ends by
//   reading   the next request's header, then its body   the request, an error, a time-out
//   working   the Api answers; the socket is watched     the answer, or the client leaves
//   writing   the answer, piece by piece                 the last piece, a time-out of one piece
//
// A WebSocket's request ends the session: the connection continues as a WebSocket. All functions
// run on the connection's strand, except the Api's answer, which is posted to it.

#include "web-gateway/http_session.h"

#include <optional>
#include <string>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

#include "core/base/log.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/base/trace_context.h"
#include "core/base/version.h"

namespace isoscope::gateway {
namespace {

// The rest of a refused request is read for this long.
constexpr absl::Duration kDrainTime = absl::Seconds(1);

class HttpSession : public std::enable_shared_from_this<HttpSession> {
 public:
  HttpSession(std::shared_ptr<PeerStream> stream, GatewayParts* parts,
              std::shared_ptr<Connections::Lease> lease)
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
  // Ends the session when the gateway shuts down.
  void End(bool at_once) {
    is_ending_ = true;
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

  void Read(absl::Duration timeout) {
    if (is_ending_) {
      Close();
      return;
    }
    is_reading_ = true;
    stream_->ReadRequest(timeout, parts_->limits.request_timeout,
                         [self = shared_from_this()](ReadError error, const std::string& message) {
                           self->OnRead(error, message);
                         });
  }

  void OnRead(ReadError error, const std::string& message) {
    is_reading_ = false;
    if (error != ReadError::kNone) {
      OnReadError(error, message);
    } else if (request().asks_websocket) {
      Upgrade();
    } else {
      OnRequest();
    }
  }

  // A client that has left gets no answer; one that did not send HTTP gets an error.
  void OnReadError(ReadError error, const std::string& message) {
    if (error == ReadError::kEnd) {
      Close();
      return;
    }
    is_ending_ = true;
    has_unread_bytes_ = true;
    const int status = error == ReadError::kLongHeader ? 431
                       : error == ReadError::kLongBody ? 413
                                                       : 400;
    const std::string reason =
        status == 431
            ? absl::StrCat("the header is longer than ", PeerStream::kMaxHeaderBytes, " bytes")
        : status == 413
            ? absl::StrCat("the body is longer than ", PeerStream::kMaxBodyBytes, " bytes")
            : absl::StrCat("this is no HTTP/1.1: ", message);
    WriteResponse(ErrorResponse(absl::InvalidArgumentError(reason), status));
  }

  [[nodiscard]] PeerRequest& request() const { return *stream_->request(); }
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
    ISOSCOPE_ASSIGN_OR_RETURN(Target target, ParseTarget(request().target));
    const std::string token = target.TakeParameter("token");
    const std::string host = Field("Host");
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
    std::string token = TokenOfProtocols(Field("Sec-WebSocket-Protocol"));
    return token.empty() ? Field("Authorization") : absl::StrCat("Bearer ", token);
  }

  // Identifies the caller, for limits by user: by token, else by address.
  std::string Caller() {
    return user_token_.empty() ? absl::StrCat("address ", stream_->RemoteAddress())
                               : absl::StrCat("token ", user_token_);
  }

  void OnRequest() {
    started_ = base::MonotonicNow();
    origin_ = Field("Origin");
    IdentifyRequest();
    is_head_ = request().method == "HEAD";
    if (!request().keeps_alive) {
      is_ending_ = true;
    }
    absl::StatusOr<Target> target = Admit();
    if (request().method == "OPTIONS" && parts_->access.IsAllowedOrigin(origin_)) {
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
    HttpRequest asked{.method = is_head_ ? "GET" : request().method,
                      .is_head = is_head_,
                      .target = *std::move(target),
                      .token = user_token_,
                      .caller = Caller(),
                      .if_none_match = Field("If-None-Match"),
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
    WriteResponse(std::move(response));
  }

  void Upgrade() {
    origin_ = Field("Origin");
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
      ServeWebSocket(stream_, user_token_, identity_, parts_, std::move(lease_));
    }
  }

  static const Target& InteractTarget() {
    static const Target target{.segments = {"v1", "interact"}};
    return target;
  }

  [[nodiscard]] PeerFields MakeFields() const {
    PeerFields fields;
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
                          "X-Isoscope-Time, X-Request-Id");
      fields.emplace_back("Vary", "Origin");
    }
    if (is_ending_) {
      fields.emplace_back("Connection", "close");
    }
    return fields;
  }

  void WritePreflight() {
    PeerAnswer answer{.status = 204, .fields = MakeFields()};
    SetField("Access-Control-Allow-Methods", "GET, POST", &answer.fields);
    SetField("Access-Control-Allow-Headers",
             "Authorization, Content-Type, If-None-Match, traceparent", &answer.fields);
    SetField("Access-Control-Max-Age", "600", &answer.fields);
    Write(std::move(answer), /*hold=*/nullptr);
  }

  void WriteResponse(HttpResponse response) {
    parts_->metrics->CountRequest(response.status, base::MonotonicNow() - started_);
    base::LogDebug("http_request",
                   {{"request", identity_.request_id()},
                    {"method", request().method},
                    {"status", response.status},
                    {"duration_ms", base::LogMilliseconds(base::MonotonicNow() - started_)}});
    PeerAnswer answer{.status = response.status};
    if (!response.file_path.empty()) {
      absl::StatusOr<AnswerFile> file = AnswerFile::Open(response.file_path);
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
      SetField(name, value, &answer.fields);
    }
    if (!response.content_type.empty()) {
      SetField("Content-Type", response.content_type, &answer.fields);
    }
    const bool has_body = answer.file.is_open() || (!is_head_ && response.status != 304);
    if (has_body || (response.status != 304 && !response.has_unknown_length)) {
      SetField("Content-Length",
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
  void Write(PeerAnswer answer, std::shared_ptr<void> hold) {
    stream_->WriteAnswer(std::move(answer), parts_->limits.write_timeout,
                         [self = shared_from_this(), hold = std::move(hold)](bool is_ok) {
                           if (is_ok && !self->is_ending_) {
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
  std::shared_ptr<Connections::Lease> lease_;
  const std::shared_ptr<PeerStream> stream_;
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
};

}  // namespace

void ServeHttp(std::shared_ptr<PeerStream> stream, GatewayParts* parts,
               std::shared_ptr<Connections::Lease> lease) {
  std::make_shared<HttpSession>(std::move(stream), parts, std::move(lease))->Run();
}

}  // namespace isoscope::gateway
