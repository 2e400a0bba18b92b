// One viewer: a WebSocket on one side, a stream of the coordinator on the other.
//
//   from the viewer        one message at a time: decoded, queued in the stream, then the next
//                          one is read
//   from the coordinator   a response becomes a frame of the queue; it replaces those that still wait
//                          there, which are reported as shown: that returns their credit. A tile
//                          replaces none: it waits behind them
//   to the viewer          one write under way; when it is done, the oldest frame is next
//
// So a viewer that does not read holds two frames here, or as many tiles as the queue has, and no
// thread. It is dropped when a write exceeds its time limit.
//
// All functions run on the connection's strand, except the stream's callbacks, which post to it.
// The stream holds the session until it ends; the session drops the stream when it ends.

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/string_view.h"
#include "absl/time/time.h"

#include "core/base/log.h"
#include "core/base/printable.h"
#include "isoscope/v1/interact_service.pb.h"
#include "web-gateway/api/frame_message.h"
#include "web-gateway/api/interact_stream.h"
#include "web-gateway/http_session.h"

namespace isoscope::gateway {
namespace {

namespace v1 = isoscope::v1;

constexpr absl::Duration kHandshakeTimeout = absl::Seconds(10);
// A viewer must answer a close within this time.
constexpr absl::Duration kCloseTimeout = absl::Seconds(2);

// Codes of a close, by RFC 6455.
constexpr std::uint16_t kGoingAway = 1001;
constexpr std::uint16_t kPolicyError = 1008;
constexpr std::uint16_t kInternalError = 1011;

// Returns the first whole characters of UTF-8 that fit: the reason of a close has room for no
// remark.
absl::string_view FittingPart(absl::string_view text, std::size_t max_bytes) {
  if (text.size() <= max_bytes) {
    return text;
  }
  std::size_t size = max_bytes;
  while (size > 0 && (static_cast<unsigned char>(text[size]) & 0xC0U) == 0x80U) {
    --size;
  }
  return text.substr(0, size);
}

class WebSocketSession : public std::enable_shared_from_this<WebSocketSession> {
 public:
  WebSocketSession(std::shared_ptr<http::PeerStream> socket, std::string token,
                   base::TraceContext identity, GatewayParts* parts,
                   std::shared_ptr<http::Connections::Lease> lease)
      : parts_(parts),
        token_(std::move(token)),
        identity_(std::move(identity)),
        lease_(std::move(lease)),
        socket_(std::move(socket)) {}

  void Run() {
    lease_->SetCloser([weak = weak_from_this()](bool at_once) {
      if (const std::shared_ptr<WebSocketSession> session = weak.lock()) {
        session->socket_->Post([session, at_once] { session->End(at_once); });
      }
    });
    http::WebSocketOptions options{.handshake_timeout = kHandshakeTimeout,
                                   .idle_timeout = parts_->limits.idle_timeout,
                                   .max_message_bytes = kMaxRequestBytes};
    if (OffersInteractProtocol(socket_->request()->Field("Sec-WebSocket-Protocol"))) {
      options.protocol = std::string(kInteractProtocol);
    }
    socket_->AcceptWebSocket(options, [self = shared_from_this()](bool is_ok) {
      if (is_ok) {
        self->OnAccept();
      } else {
        self->Finish();
      }
    });
  }

 private:
  void OnAccept() {
    base::LogInfo("viewer_connected", {{"request", identity_.request_id()}});
    is_open_ = true;
    parts_->metrics->viewers.fetch_add(1);
    stream_ = InteractStream::Open(
        parts_->client, token_, identity_,
        [self = shared_from_this()](v1::InteractResponse response) {
          FrameQueue::Frame frame{.frame_number = response.frame_number(),
                                  .adds_to_picture = AddsToPicture(response),
                                  .bytes = ""};
          frame.bytes = EncodeFrame(std::move(response));
          self->socket_->Post(
              [self, frame = std::move(frame)]() mutable { self->Offer(std::move(frame)); });
        },
        [self = shared_from_this()](const absl::Status& status) {
          self->socket_->Post([self, status] { self->OnStreamEnd(status); });
        });
    Read();
  }

  void Read() {
    socket_->ReadMessage([self = shared_from_this()](bool is_ok) { self->OnRead(is_ok); });
  }

  void OnRead(bool is_ok) {
    if (!is_ok) {
      Finish();  // a close ends here, too
      return;
    }
    if (!is_closing_) {
      TakeMessage();
    }
    Read();
  }

  void TakeMessage() {
    if (!socket_->is_text()) {
      Close(kPolicyError, "the message is binary: this takes InteractRequest as JSON text");
      return;
    }
    absl::StatusOr<v1::InteractRequest> request = DecodeInteractRequest(socket_->message());
    if (request.ok()) {
      stream_->Send(*std::move(request));
    } else {
      Close(kPolicyError, request.status().message());
    }
  }

  void Offer(FrameQueue::Frame frame) {
    if (is_closing_ || stream_ == nullptr) {
      return;
    }
    for (const std::int64_t replaced : queue_.Offer(std::move(frame))) {
      ++replaced_count_;
      parts_->metrics->replaced_frames.Add();
      v1::InteractRequest shown;
      shown.mutable_frame_shown()->set_frame_number(replaced);
      stream_->Send(std::move(shown));
    }
    if (!is_writing_) {
      WriteNext();
    }
  }

  void WriteNext() {
    std::optional<FrameQueue::Frame> frame = queue_.Take();
    if (!frame || is_closing_) {
      return;
    }
    is_writing_ = true;
    DropAfter(parts_->limits.write_timeout);
    socket_->WriteMessage(std::move(frame->bytes),
                          [self = shared_from_this()](bool is_ok) { self->OnWrite(is_ok); });
  }

  void OnWrite(bool is_ok) {
    is_writing_ = false;
    if (!is_ok) {
      Finish();
      return;
    }
    ++sent_count_;
    parts_->metrics->sent_frames.Add();
    if (!is_closing_) {
      socket_->CancelTimer();
      WriteNext();
    }
  }

  // Drops the connection unless the timer is set again, or cancelled, before.
  void DropAfter(absl::Duration timeout) {
    socket_->SetTimer(timeout, [self = shared_from_this()] { self->Finish(); });
  }

  void OnStreamEnd(const absl::Status& status) {
    if (status.ok()) {
      Close(kInternalError, "the coordinator has ended the stream");
    } else if (absl::IsInvalidArgument(status) || absl::IsUnauthenticated(status) ||
               absl::IsPermissionDenied(status)) {
      Close(kPolicyError, status.message());
    } else {
      Close(kInternalError, status.message());
    }
  }

  // Ends the session when the gateway shuts down.
  void End(bool at_once) {
    if (at_once || !is_open_) {
      Finish();
    } else {
      Close(kGoingAway, "the gateway shuts down");
    }
  }

  void Close(std::uint16_t code, absl::string_view reason) {
    if (is_closing_) {
      return;
    }
    is_closing_ = true;
    const std::string text = base::ValidUtf8(reason);
    base::LogInfo("viewer_closed", {{"request", identity_.request_id()},
                                    {"code", static_cast<int>(code)},
                                    {"reason", reason}});
    if (stream_ != nullptr) {
      stream_->Cancel();
    }
    DropAfter(kCloseTimeout);
    socket_->CloseWebSocket(code, FittingPart(text, http::PeerStream::kMaxReasonBytes),
                            [self = shared_from_this()] { self->Finish(); });
  }

  // Ends everything; harmless when called again.
  void Finish() {
    is_closing_ = true;
    socket_->CancelTimer();
    socket_->CloseSocket();
    if (stream_ != nullptr) {
      stream_->Cancel();
      stream_ = nullptr;
    }
    if (lease_ != nullptr && is_open_) {
      base::LogInfo("viewer_left", {{"request", identity_.request_id()},
                                    {"frames", sent_count_},
                                    {"replaced", replaced_count_}});
      parts_->metrics->viewers.fetch_sub(1);
    }
    lease_ = nullptr;
  }

  GatewayParts* const parts_;
  const std::string token_;
  const base::TraceContext identity_;
  std::shared_ptr<http::Connections::Lease> lease_;
  const std::shared_ptr<http::PeerStream> socket_;  // its timer: of the write, or of the close
  std::shared_ptr<InteractStream> stream_;
  FrameQueue queue_;
  std::int64_t sent_count_ = 0;
  std::int64_t replaced_count_ = 0;
  bool is_open_ = false;
  bool is_writing_ = false;
  bool is_closing_ = false;
};

}  // namespace

void ServeWebSocket(std::shared_ptr<http::PeerStream> stream, std::string token,
                    const base::TraceContext& identity, GatewayParts* parts,
                    std::shared_ptr<http::Connections::Lease> lease) {
  std::make_shared<WebSocketSession>(std::move(stream), std::move(token), identity, parts,
                                     std::move(lease))
      ->Run();
}

}  // namespace isoscope::gateway
