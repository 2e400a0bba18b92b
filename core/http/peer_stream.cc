// The connection of a browser, in these sources:
//
//   transport      bytes over TCP or TLS
//   http_reader    messages of HTTP out of those bytes
//   peer_message   requests and answers, and the bytes of an answer that are not sent yet
//   peer_stream    the operations on them, and WebSockets
//   peer_listener  the socket that takes connections, and their threads
//
// Two loops here and in http_reader write answers and parse requests, as Beast's own do.

#include "core/http/peer_stream.h"

#include <poll.h>

#include <algorithm>
#include <chrono>
#include <optional>
#include <utility>

#include <boost/asio/buffer.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <boost/beast/websocket/stream.hpp>

#include "core/base/monotonic_time.h"
#include "core/http/http_reader.h"
#include "core/http/transport.h"

namespace isoscope::http {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace beast_http = beast::http;
namespace websocket = beast::websocket;
using asio::ip::tcp;
using boost::system::error_code;

// The interval of checks of a TLS client that has sent data while its answer is in work.
constexpr std::chrono::milliseconds kWatchPause{200};
// Bytes of a refused request that are read at a time.
constexpr std::size_t kDrainPieceBytes = 4096;
constexpr std::size_t kFirstReadBytes = 4096;
constexpr absl::string_view kContinue = "HTTP/1.1 100 Continue\r\n\r\n";

class PeerStreamImpl final : public PeerStream,
                             public std::enable_shared_from_this<PeerStreamImpl> {
 public:
  PeerStreamImpl(std::unique_ptr<Transport> transport, std::shared_ptr<asio::ssl::context> context)
      : context_(std::move(context)),
        transport_(std::move(transport)),
        timer_(transport_->get_executor()),
        watch_timer_(transport_->get_executor()) {}

  void Post(std::function<void()> task) override {
    asio::post(transport_->get_executor(), std::move(task));
  }
  [[nodiscard]] bool has_tls() const override { return context_ != nullptr; }
  [[nodiscard]] std::string RemoteAddress() const override {
    error_code ignored;
    return transport_->next_layer().socket().remote_endpoint(ignored).address().to_string();
  }
  void SetTimer(absl::Duration time, std::function<void()> task) override {
    timer_.expires_after(absl::ToChronoMilliseconds(time));
    Wait(&timer_, std::move(task));
  }
  void CancelTimer() override { timer_.cancel(); }
  void CloseSocket() override { transport_->next_layer().close(); }

  void Handshake(absl::Duration timeout, Done done) override {
    transport_->ExpireAfter(timeout);
    transport_->Handshake(
        context_.get(), asio::ssl::stream_base::server,
        [self = shared_from_this(), done = std::move(done)](error_code error) { done(!error); });
  }

  void ReadHeader(absl::Duration idle_timeout, absl::Duration header_timeout,
                  RequestDone done) override {
    parser_.emplace();
    parser_->header_limit(kMaxHeaderBytes);
    parser_->body_limit(kMaxBodyBytes);
    parser_->eager(false);
    request_ = PeerRequest();
    const auto read = [this, header_timeout, done](error_code error) {
      if (error) {
        FinishRead(error, done);
        return;
      }
      transport_->ExpireAfter(header_timeout);
      Read(MessagePart::kHeader, [this, done](error_code failed) { FinishHeader(failed, done); });
    };
    if (buffer_.size() > 0) {  // of a client that did not wait for the last answer
      read({});
      return;
    }
    transport_->ExpireAfter(idle_timeout);
    transport_->Read(buffer_.prepare(kFirstReadBytes),
                     [self = shared_from_this(), read](error_code error, std::size_t size) {
                       self->buffer_.commit(size);
                       read(error);
                     });
  }

  void ReadBody(absl::Duration timeout, RequestDone done) override {
    transport_->ExpireAfter(timeout);
    parser_->eager(true);
    Read(MessagePart::kWhole, [this, done = std::move(done)](error_code error) {
      if (!error) {
        request_.body = std::move(parser_->get().body());
      }
      FinishRead(error, done);
    });
  }

  void WriteContinue(absl::Duration timeout, Done done) override {
    if (buffer_.size() > 0) {
      done(true);
      return;
    }
    transport_->ExpireAfter(timeout);
    WriteAll(asio::const_buffer(kContinue.data(), kContinue.size()), std::move(done));
  }

  PeerRequest* request() override { return &request_; }

  void WatchPeer(std::function<void()> on_left) override {
    // A peer may wait long without sending data.
    transport_->next_layer().expires_never();
    on_left_ = std::move(on_left);
    ++watch_number_;
    Watch();
  }
  void StopWatch() override {
    on_left_ = nullptr;
    ++watch_number_;
    error_code ignored;
    transport_->socket().cancel(ignored);
    watch_timer_.cancel();
  }

  void WriteAnswer(PeerAnswer answer, const WriteLimits& limits, Done done) override {
    unsent_.emplace(std::move(answer));
    write_end_ = base::MonotonicNow() + limits.piece_timeout +
                 absl::Seconds(static_cast<double>(unsent_->size()) / limits.min_bytes_per_second);
    WriteNext(limits.piece_timeout, std::move(done));
  }

  void End(bool has_unread_bytes, absl::Duration timeout, std::function<void()> done) override {
    if (has_tls() && !has_unread_bytes) {
      transport_->ExpireAfter(timeout);
      transport_->Shutdown(
          [self = shared_from_this(), done = std::move(done)](error_code) { done(); });
      return;
    }
    error_code ignored;
    transport_->socket().shutdown(tcp::socket::shutdown_send, ignored);
    if (has_unread_bytes) {
      transport_->ExpireAfter(timeout);
      Drain(std::move(done));
    } else {
      done();
    }
  }

  void Refuse(absl::string_view bytes) override {
    error_code ignored;
    tcp::socket& socket = transport_->socket();
    socket.non_blocking(true, ignored);
    socket.send(asio::buffer(bytes.data(), bytes.size()), 0, ignored);
    socket.shutdown(tcp::socket::shutdown_both, ignored);
  }

  void AcceptWebSocket(const WebSocketOptions& options, Done done) override {
    websocket_.emplace(*transport_);
    transport_->next_layer().expires_never();
    websocket_->set_option(websocket::stream_base::timeout{
        .handshake_timeout = absl::ToChronoMilliseconds(options.handshake_timeout),
        .idle_timeout = absl::ToChronoMilliseconds(options.idle_timeout),
        .keep_alive_pings = true});
    websocket_->read_message_max(options.max_message_bytes);
    websocket_->auto_fragment(false);
    websocket_->binary(true);
    if (!options.protocol.empty()) {
      websocket_->set_option(websocket::stream_base::decorator(
          [protocol = options.protocol](websocket::response_type& response) {
            response.set(beast_http::field::sec_websocket_protocol, protocol);
          }));
    }
    websocket_->async_accept(parser_->get(), ToErrorDone(std::move(done)));
  }

  void ReadMessage(Done done) override {
    message_.clear();
    websocket_->async_read(message_, ToIoDone(std::move(done)));
  }
  [[nodiscard]] absl::string_view message() const override {
    const auto bytes = message_.cdata();
    return {static_cast<const char*>(bytes.data()), bytes.size()};
  }
  [[nodiscard]] bool is_text() const override { return websocket_->got_text(); }

  void WriteMessage(std::string message, Done done) override {
    outgoing_ = std::move(message);
    websocket_->async_write(asio::const_buffer(asio::buffer(outgoing_)), ToIoDone(std::move(done)));
  }

  void CloseWebSocket(std::uint16_t code, absl::string_view reason,
                      std::function<void()> done) override {
    websocket_->async_close(
        websocket::close_reason(static_cast<websocket::close_code>(code),
                                beast::string_view(reason.data(), reason.size())),
        ToErrorDone([done = std::move(done)](bool) { done(); }));
  }

 private:
  ErrorDone ToErrorDone(Done done) {
    return [self = shared_from_this(), done = std::move(done)](error_code error) { done(!error); };
  }
  IoDone ToIoDone(Done done) {
    return [self = shared_from_this(), done = std::move(done)](error_code error, std::size_t) {
      done(!error);
    };
  }

  void Wait(asio::steady_timer* timer, std::function<void()> task) {
    timer->async_wait(
        ErrorDone([self = shared_from_this(), task = std::move(task)](error_code error) {
          if (!error) {
            task();
          }
        }));
  }

  void Read(MessagePart part, ErrorDone done) {
    ReadMessagePart<true>(
        transport_.get(), &buffer_, &*parser_, part,
        [self = shared_from_this(), done = std::move(done)](error_code error) { done(error); });
  }

  void FinishHeader(error_code error, const RequestDone& done) {
    if (!error) {
      beast_http::request<beast_http::string_body>& read = parser_->get();
      for (const auto& field : read) {
        request_.fields.emplace_back(field.name_string(), field.value());
      }
      // Beast looks at the first field of a name.
      for (const beast_http::field list :
           {beast_http::field::connection, beast_http::field::upgrade,
            beast_http::field::sec_websocket_protocol,
            beast_http::field::sec_websocket_extensions}) {
        if (read.count(list) > 1) {
          read.set(list, request_.List(absl::string_view(beast_http::to_string(list).data(),
                                                         beast_http::to_string(list).size())));
        }
      }
      request_.target = std::string(read.target());
      request_.is_http_1_0 = read.version() == 10;
      request_.has_body = parser_->chunked() || parser_->content_length().value_or(0) > 0;
      request_.keeps_alive = read.keep_alive();
      request_.asks_websocket = websocket::is_upgrade(read);
    }
    FinishRead(error, done);
  }

  void FinishRead(error_code error, const RequestDone& done) {
    request_.method = std::string(parser_->get().method_string());
    done(ReadErrorOf(error), error ? error.message() : "");
  }

  void WriteAll(asio::const_buffer bytes, Done done) {
    transport_->Write({bytes}, [self = shared_from_this(), bytes, done = std::move(done)](
                                   error_code error, std::size_t size) mutable {
      bytes += size;
      if (error || bytes.size() == 0) {
        done(!error);
      } else {
        self->WriteAll(bytes, std::move(done));
      }
    });
  }

  void Watch() {
    transport_->socket().async_wait(
        tcp::socket::wait_read,
        ErrorDone([self = shared_from_this(), number = watch_number_](error_code error) {
          if (error || number != self->watch_number_) {
            return;
          }
          if (self->HasLeft()) {
            std::exchange(self->on_left_, nullptr)();
          } else if (self->has_tls()) {
            self->WatchLater();
          }
        }));
  }

  // A TLS client sends close_notify before it leaves; here it looks like a next request.
  void WatchLater() {
    watch_timer_.expires_after(kWatchPause);
    Wait(&watch_timer_, [this, number = watch_number_] {
      if (number == watch_number_) {
        Watch();
      }
    });
  }

  bool HasLeft() {
    pollfd watched{.fd = transport_->socket().native_handle(), .events = POLLRDHUP, .revents = 0};
    return poll(&watched, 1, 0) == 1 && (watched.revents & (POLLRDHUP | POLLHUP | POLLERR)) != 0;
  }

  // Each piece has its own time limit: a long answer may take long, a stalled reader may not.
  void WriteNext(absl::Duration timeout, Done done) {
    if (!unsent_->Load()) {
      Finish(/*is_ok=*/false, done);
      return;
    }
    const absl::string_view head = unsent_->head();
    const absl::string_view body = unsent_->body();
    if (head.empty() && body.empty()) {
      Finish(/*is_ok=*/true, done);
      return;
    }
    transport_->ExpireAfter(std::min(timeout, write_end_ - base::MonotonicNow()));
    transport_->Write(
        {asio::buffer(head.data(), head.size()), asio::buffer(body.data(), body.size())},
        [self = shared_from_this(), timeout, done = std::move(done)](error_code error,
                                                                     std::size_t size) mutable {
          if (error) {
            self->Finish(/*is_ok=*/false, done);
            return;
          }
          self->unsent_->Consume(size);
          self->WriteNext(timeout, std::move(done));
        });
  }

  void Finish(bool is_ok, const Done& done) {
    unsent_.reset();
    done(is_ok);
  }

  void Drain(std::function<void()> done) {
    buffer_.clear();
    transport_->Read(
        buffer_.prepare(kDrainPieceBytes),
        [self = shared_from_this(), done = std::move(done)](error_code error, std::size_t) mutable {
          if (error) {
            done();
          } else {
            self->Drain(std::move(done));
          }
        });
  }

  const std::shared_ptr<asio::ssl::context> context_;  // null: no TLS
  const std::unique_ptr<Transport> transport_;
  asio::steady_timer timer_;
  asio::steady_timer watch_timer_;

  beast::flat_buffer buffer_{kMaxHeaderBytes + kMaxBodyBytes};
  std::optional<beast_http::request_parser<beast_http::string_body>> parser_;
  PeerRequest request_;
  std::function<void()> on_left_;
  int watch_number_ = 0;  // of the last watch

  std::optional<UnsentAnswer> unsent_;
  base::MonotonicTime write_end_;  // of the whole answer

  // Compression is off, and its code is not compiled.
  std::optional<websocket::stream<Transport&, /*deflateSupported=*/false>> websocket_;
  beast::flat_buffer message_;
  std::string outgoing_;
};

}  // namespace

std::shared_ptr<PeerStream> PeerStream::Make(std::unique_ptr<Transport> transport,
                                             std::shared_ptr<asio::ssl::context> context) {
  return std::make_shared<PeerStreamImpl>(std::move(transport), std::move(context));
}

}  // namespace isoscope::http
