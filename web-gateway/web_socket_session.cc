// One viewer: a WebSocket on one side, a stream of the coordinator on the other.
//
//   from the viewer        a message at a time: decoded, handed to the stream, the next one is read
//   from the coordinator   a response becomes the frame of the slot; one that still waits there is
//                          replaced, and reported as shown, so that its credit comes back
//   to the viewer          one write under way; when it is done, the slot's frame is next
//
// So a viewer that does not read holds at most two frames here, and no thread. It is dropped when a
// write takes longer than the time-out.
//
// Everything runs on the connection's strand, but for the stream's callbacks, which post to it. The
// stream holds the session until it ends; the session drops the stream when it ends.

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include <boost/asio/buffer.hpp>
#include <boost/asio/dispatch.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket/stream.hpp>

#include "core/base/log.h"
#include "web-gateway/frame_message.h"
#include "web-gateway/http_session.h"
#include "web-gateway/interact_stream.h"

namespace isoscope::gateway {
namespace {

namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
namespace v1 = isoscope::v1;
using boost::system::error_code;

constexpr std::chrono::seconds kHandshakeTimeout{10};
// In which a viewer must answer a close.
constexpr std::chrono::seconds kCloseTimeout{2};
// What a close frame has room for, by RFC 6455.
constexpr std::size_t kMaxReasonBytes = 123;

// Cuts UTF-8 to a length without cutting a character.
absl::string_view CutText(absl::string_view text, std::size_t max_bytes) {
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
  WebSocketSession(PeerStream stream, std::string token, base::TraceContext identity,
                   GatewayParts* parts, std::shared_ptr<Connections::Lease> lease)
      : parts_(parts),
        token_(std::move(token)),
        identity_(std::move(identity)),
        lease_(std::move(lease)),
        socket_(std::move(stream)),
        timer_(socket_.get_executor()) {}

  void Run(const http::request<http::string_body>& upgrade) {
    lease_->SetCloser([weak = weak_from_this()](bool at_once) {
      if (const std::shared_ptr<WebSocketSession> session = weak.lock()) {
        boost::asio::post(session->socket_.get_executor(),
                          [session, at_once] { session->End(at_once); });
      }
    });
    beast::get_lowest_layer(socket_).expires_never();
    socket_.set_option(websocket::stream_base::timeout{
        .handshake_timeout = kHandshakeTimeout,
        .idle_timeout = absl::ToChronoMilliseconds(parts_->limits.idle_timeout),
        .keep_alive_pings = true});
    socket_.read_message_max(kMaxRequestBytes);
    socket_.auto_fragment(false);
    socket_.binary(true);
    const auto offered = upgrade[http::field::sec_websocket_protocol];
    if (OffersInteractProtocol(absl::string_view(offered.data(), offered.size()))) {
      socket_.set_option(websocket::stream_base::decorator([](websocket::response_type& response) {
        response.set(http::field::sec_websocket_protocol,
                     boost::string_view(kInteractProtocol.data(), kInteractProtocol.size()));
      }));
    }
    socket_.async_accept(upgrade, [self = shared_from_this()](error_code error) {
      if (error) {
        self->Finish();
      } else {
        self->OnAccept();
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
          const std::int64_t number = response.frame_number();
          FrameSlot::Frame frame{.frame_number = number, .bytes = EncodeFrame(std::move(response))};
          boost::asio::post(
              self->socket_.get_executor(),
              [self, frame = std::move(frame)]() mutable { self->Offer(std::move(frame)); });
        },
        [self = shared_from_this()](const absl::Status& status) {
          boost::asio::post(self->socket_.get_executor(),
                            [self, status] { self->OnStreamEnd(status); });
        });
    Read();
  }

  void Read() {
    socket_.async_read(incoming_, [self = shared_from_this()](error_code error, std::size_t) {
      self->OnRead(error);
    });
  }

  void OnRead(error_code error) {
    if (error) {
      Finish();  // also the end of a close
      return;
    }
    if (!is_closing_) {
      TakeMessage();
    }
    incoming_.clear();
    Read();
  }

  void TakeMessage() {
    if (!socket_.got_text()) {
      Close(websocket::close_code::policy_error,
            "the message is binary: this takes InteractRequest as JSON text");
      return;
    }
    const auto bytes = incoming_.cdata();
    absl::StatusOr<v1::InteractRequest> request = DecodeInteractRequest(
        absl::string_view(static_cast<const char*>(bytes.data()), bytes.size()));
    if (request.ok()) {
      stream_->Send(*std::move(request));
    } else {
      Close(websocket::close_code::policy_error, request.status().message());
    }
  }

  void Offer(FrameSlot::Frame frame) {
    if (is_closing_ || stream_ == nullptr) {
      return;
    }
    if (const std::optional<std::int64_t> replaced = slot_.Offer(std::move(frame))) {
      ++replaced_count_;
      parts_->metrics->replaced_frames.Add();
      v1::InteractRequest shown;
      shown.mutable_frame_shown()->set_frame_number(*replaced);
      stream_->Send(std::move(shown));
    }
    if (!is_writing_) {
      WriteNext();
    }
  }

  void WriteNext() {
    std::optional<FrameSlot::Frame> frame = slot_.Take();
    if (!frame || is_closing_) {
      return;
    }
    is_writing_ = true;
    outgoing_ = std::move(frame->bytes);
    DropAfter(std::chrono::milliseconds(absl::ToInt64Milliseconds(parts_->limits.write_timeout)));
    socket_.async_write(
        boost::asio::buffer(outgoing_),
        [self = shared_from_this()](error_code error, std::size_t) { self->OnWrite(error); });
  }

  void OnWrite(error_code error) {
    is_writing_ = false;
    if (error) {
      Finish();
      return;
    }
    ++sent_count_;
    parts_->metrics->sent_frames.Add();
    if (!is_closing_) {
      timer_.cancel();
      WriteNext();
    }
  }

  // Drops the connection if the timer is not set anew, or cancelled, before.
  void DropAfter(std::chrono::milliseconds timeout) {
    timer_.expires_after(timeout);
    timer_.async_wait([self = shared_from_this()](error_code error) {
      if (!error) {
        self->Finish();
      }
    });
  }

  void OnStreamEnd(const absl::Status& status) {
    if (status.ok()) {
      Close(websocket::close_code::internal_error, "the coordinator has ended the stream");
    } else if (absl::IsInvalidArgument(status) || absl::IsUnauthenticated(status) ||
               absl::IsPermissionDenied(status)) {
      Close(websocket::close_code::policy_error, status.message());
    } else {
      Close(websocket::close_code::internal_error, status.message());
    }
  }

  // The gateway shuts down.
  void End(bool at_once) {
    if (at_once || !is_open_) {
      Finish();
    } else {
      Close(websocket::close_code::going_away, "the gateway shuts down");
    }
  }

  void Close(websocket::close_code code, absl::string_view reason) {
    if (is_closing_) {
      return;
    }
    is_closing_ = true;
    const absl::string_view cut = CutText(reason, kMaxReasonBytes);
    base::LogInfo("viewer_closed", {{"request", identity_.request_id()},
                                    {"code", static_cast<int>(code)},
                                    {"reason", reason}});
    if (stream_ != nullptr) {
      stream_->Cancel();
    }
    DropAfter(kCloseTimeout);
    socket_.async_close(websocket::close_reason(code, boost::string_view(cut.data(), cut.size())),
                        [self = shared_from_this()](error_code) { self->Finish(); });
  }

  // Ends everything; harmless when called again.
  void Finish() {
    is_closing_ = true;
    timer_.cancel();
    beast::get_lowest_layer(socket_).close();
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
  std::shared_ptr<Connections::Lease> lease_;
  websocket::stream<PeerStream> socket_;
  boost::asio::steady_timer timer_;  // of the write, or of the close
  std::shared_ptr<InteractStream> stream_;
  beast::flat_buffer incoming_;
  FrameSlot slot_;
  std::string outgoing_;
  std::int64_t sent_count_ = 0;
  std::int64_t replaced_count_ = 0;
  bool is_open_ = false;
  bool is_writing_ = false;
  bool is_closing_ = false;
};

}  // namespace

void ServeWebSocket(PeerStream stream, std::string token, http::request<http::string_body> upgrade,
                    const base::TraceContext& identity, GatewayParts* parts,
                    std::shared_ptr<Connections::Lease> lease) {
  const auto request = std::make_shared<http::request<http::string_body>>(std::move(upgrade));
  const auto session = std::make_shared<WebSocketSession>(std::move(stream), std::move(token),
                                                          identity, parts, std::move(lease));
  session->Run(*request);
}

}  // namespace isoscope::gateway
