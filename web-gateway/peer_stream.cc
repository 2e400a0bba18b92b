// Three layers:
//
//   Transport         bytes over TCP or TLS
//   PeerStreamImpl    requests, answers and messages of a connection
//   PeerListenerImpl  the socket that takes connections, and their threads
//
// Asio and Beast are templates over streams and handlers, and each pair is compiled anew. So there
// is one stream, Transport, and its operations take handlers of one type, IoDone; the WebSocket's
// own handlers are wrapped in that type. Two loops here parse requests and write answers, as
// Beast's own do.

#include "web-gateway/peer_stream.h"

#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <optional>
#include <thread>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include <boost/asio/buffer.hpp>
#include <boost/asio/dispatch.hpp>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/ssl/host_name_verification.hpp>
#include <boost/asio/ssl/stream.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/strand.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <sys/stat.h>

#include "core/base/log.h"
#include "core/base/status_macros.h"

namespace isoscope::gateway {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using asio::ip::tcp;
using boost::system::error_code;

// The interval of checks of a TLS client that has sent data while its answer is in work.
constexpr std::chrono::milliseconds kWatchPause{200};
// The pause after an error of accept, such as too many open files.
constexpr std::chrono::milliseconds kAcceptPause{100};
// Bytes of a file, or of a refused request, that are read at a time.
constexpr std::size_t kPieceBytes = 64 * 1024;
constexpr std::size_t kDrainPieceBytes = 4096;
// The most that is read from a socket at a time.
constexpr std::size_t kMaxReadBytes = 64 * 1024;
constexpr std::uint64_t kMaxReplyBytes = 64 * 1024;

using ErrorDone = std::function<void(error_code)>;
using IoDone = std::function<void(error_code, std::size_t)>;
// The most buffers of a sequence that one write takes. The rest follows in further writes.
using WriteBuffers = std::array<asio::const_buffer, 4>;

absl::string_view View(boost::beast::string_view text) { return {text.data(), text.size()}; }

// TCP, with or without TLS on it; a stream as Asio understands them. Belongs to the strand of its
// socket.
class Transport {
 public:
  using next_layer_type = beast::tcp_stream;
  using executor_type = next_layer_type::executor_type;

  explicit Transport(tcp::socket socket) : tcp_(std::move(socket)) {}
  explicit Transport(asio::io_context& io) : tcp_(io) {}

  executor_type get_executor() { return tcp_.get_executor(); }
  next_layer_type& next_layer() { return tcp_; }
  [[nodiscard]] const next_layer_type& next_layer() const { return tcp_; }
  tcp::socket& socket() { return tcp_.socket(); }
  void ExpireAfter(absl::Duration time) { tcp_.expires_after(absl::ToChronoMilliseconds(time)); }

  // Puts TLS on the connection. `context` outlives the transport.
  void Handshake(asio::ssl::context* context, asio::ssl::stream_base::handshake_type type,
                 ErrorDone done) {
    tls_.emplace(tcp_, *context);
    tls_->async_handshake(type, std::move(done));
  }
  // Sends TLS's close_notify and waits for the peer's, so that the peer can tell an end from a cut.
  // REQUIRES: Handshake. Most errors mean that the peer has just closed.
  void Shutdown(ErrorDone done) { tls_->async_shutdown(std::move(done)); }

  void Read(asio::mutable_buffer buffer, IoDone done) {
    if (tls_) {
      tls_->async_read_some(buffer, std::move(done));
    } else {
      tcp_.async_read_some(buffer, std::move(done));
    }
  }
  void Write(const WriteBuffers& buffers, IoDone done) {
    if (tls_) {
      tls_->async_write_some(buffers, std::move(done));
    } else {
      tcp_.async_write_some(buffers, std::move(done));
    }
  }

  // Beast requires these.
  template <typename Buffers, typename Handler>
  void async_read_some(const Buffers& buffers, Handler&& handler) {
    asio::mutable_buffer first;
    for (auto it = asio::buffer_sequence_begin(buffers);
         it != asio::buffer_sequence_end(buffers) && first.size() == 0; ++it) {
      first = *it;
    }
    Read(first, Erase(std::forward<Handler>(handler)));
  }
  template <typename Buffers, typename Handler>
  void async_write_some(const Buffers& buffers, Handler&& handler) {
    WriteBuffers some;
    std::size_t count = 0;
    for (auto it = asio::buffer_sequence_begin(buffers);
         it != asio::buffer_sequence_end(buffers) && count < some.size(); ++it) {
      const asio::const_buffer buffer = *it;
      if (buffer.size() > 0) {
        some.at(count++) = buffer;
      }
    }
    Write(some, Erase(std::forward<Handler>(handler)));
  }
  // A WebSocket calls it after its close. Beast finds it by its name.
  friend void teardown(beast::role_type role, Transport& transport, error_code& error) {
    websocket::teardown(role, transport.socket(), error);
  }
  template <typename Handler>
  friend void async_teardown(beast::role_type role, Transport& transport, Handler&& handler) {
    const auto held = std::make_shared<std::decay_t<Handler>>(std::forward<Handler>(handler));
    ErrorDone done = [held](error_code error) { std::move (*held)(error); };
    if (transport.tls_) {
      transport.Shutdown(std::move(done));
    } else {
      websocket::async_teardown(role, transport.socket(), std::move(done));
    }
  }

 private:
  // Beast's handlers can't be copied, and have many types.
  template <typename Handler>
  static IoDone Erase(Handler&& handler) {
    return [held = std::make_shared<std::decay_t<Handler>>(std::forward<Handler>(handler))](
               error_code error, std::size_t size) { std::move (*held)(error, size); };
  }

  beast::tcp_stream tcp_;
  std::optional<asio::ssl::stream<beast::tcp_stream&>> tls_;
};

// Parses until `is_done`, and reads the bytes for that. The buffer keeps the rest. Calls `done`
// once; all arguments live until then.
template <bool is_request>
void ReadMessagePart(Transport* transport, beast::flat_buffer* buffer,
                     http::basic_parser<is_request>* parser, bool (*is_done)(const void* parser),
                     const ErrorDone& done, bool has_read = false) {
  error_code error;
  while (!is_done(parser) && buffer->size() > 0 && !error) {
    buffer->consume(parser->put(buffer->data(), error));
  }
  if (error == http::error::need_more) {
    error = {};
  }
  if (error || is_done(parser)) {
    if (has_read) {
      done(error);
    } else {
      asio::post(transport->get_executor(), [done, error] { done(error); });
    }
    return;
  }
  const std::size_t size = beast::read_size(*buffer, kMaxReadBytes);
  if (size == 0) {
    done(http::error::buffer_overflow);
    return;
  }
  transport->Read(buffer->prepare(size), [=](error_code failed, std::size_t read) {
    buffer->commit(read);
    if (!failed) {
      ReadMessagePart(transport, buffer, parser, is_done, done, /*has_read=*/true);
      return;
    }
    if (failed == asio::error::eof) {
      failed = {};
      if (parser->got_some()) {
        parser->put_eof(failed);
      } else {
        failed = http::error::end_of_stream;
      }
    }
    done(failed);
  });
}

template <bool is_request>
bool HasHeader(const void* parser) {
  return static_cast<const http::basic_parser<is_request>*>(parser)->is_header_done();
}
template <bool is_request>
bool HasWhole(const void* parser) {
  return static_cast<const http::basic_parser<is_request>*>(parser)->is_done();
}

class PeerStreamImpl final : public PeerStream,
                             public std::enable_shared_from_this<PeerStreamImpl> {
 public:
  PeerStreamImpl(tcp::socket socket, std::shared_ptr<asio::ssl::context> context)
      : context_(std::move(context)),
        transport_(std::move(socket)),
        timer_(transport_.get_executor()),
        watch_timer_(transport_.get_executor()) {}

  void Post(std::function<void()> task) override {
    asio::post(transport_.get_executor(), std::move(task));
  }
  [[nodiscard]] bool has_tls() const override { return context_ != nullptr; }
  [[nodiscard]] std::string RemoteAddress() const override {
    error_code ignored;
    return transport_.next_layer().socket().remote_endpoint(ignored).address().to_string();
  }
  void SetTimer(absl::Duration time, std::function<void()> task) override {
    timer_.expires_after(absl::ToChronoMilliseconds(time));
    Wait(&timer_, std::move(task));
  }
  void CancelTimer() override { timer_.cancel(); }
  void CloseSocket() override { transport_.next_layer().close(); }

  void Handshake(absl::Duration timeout, Done done) override {
    transport_.ExpireAfter(timeout);
    transport_.Handshake(
        context_.get(), asio::ssl::stream_base::server,
        [self = shared_from_this(), done = std::move(done)](error_code error) { done(!error); });
  }

  void ReadRequest(absl::Duration header_timeout, absl::Duration body_timeout,
                   RequestDone done) override {
    parser_.emplace();
    parser_->header_limit(kMaxHeaderBytes);
    parser_->body_limit(kMaxBodyBytes);
    parser_->eager(false);
    request_ = PeerRequest();
    transport_.ExpireAfter(header_timeout);
    Read(&HasHeader<true>, [this, body_timeout, done = std::move(done)](error_code error) {
      if (error) {
        FinishRead(error, done);
        return;
      }
      request_.asks_websocket = websocket::is_upgrade(parser_->get());
      if (request_.asks_websocket) {
        FinishRead(error, done);
        return;
      }
      transport_.ExpireAfter(body_timeout);
      parser_->eager(true);
      Read(&HasWhole<true>, [this, done](error_code body_error) { FinishRead(body_error, done); });
    });
  }

  PeerRequest* request() override { return &request_; }

  void WatchPeer(std::function<void()> on_left) override {
    // A peer may wait long without sending data.
    transport_.next_layer().expires_never();
    on_left_ = std::move(on_left);
    ++watch_number_;
    Watch();
  }
  void StopWatch() override {
    on_left_ = nullptr;
    ++watch_number_;
    error_code ignored;
    transport_.socket().cancel(ignored);
    watch_timer_.cancel();
  }

  void WriteAnswer(PeerAnswer answer, absl::Duration piece_timeout, Done done) override {
    answer_ = std::move(answer);
    head_ = absl::StrCat("HTTP/1.1 ", answer_.status, " ",
                         View(http::obsolete_reason(static_cast<http::status>(answer_.status))),
                         "\r\n");
    for (const auto& [name, value] : answer_.fields) {
      absl::StrAppend(&head_, name, ": ", value, "\r\n");
    }
    absl::StrAppend(&head_, "\r\n");
    unsent_head_ = asio::buffer(head_);
    unsent_body_ = asio::buffer(answer_.body);
    file_offset_ = 0;
    WriteNext(piece_timeout, std::move(done));
  }

  void End(bool has_unread_bytes, absl::Duration timeout, std::function<void()> done) override {
    if (has_tls() && !has_unread_bytes) {
      transport_.ExpireAfter(timeout);
      transport_.Shutdown(
          [self = shared_from_this(), done = std::move(done)](error_code) { done(); });
      return;
    }
    error_code ignored;
    transport_.socket().shutdown(tcp::socket::shutdown_send, ignored);
    if (has_unread_bytes) {
      transport_.ExpireAfter(timeout);
      Drain(std::move(done));
    } else {
      done();
    }
  }

  void Refuse(absl::string_view bytes) override {
    error_code ignored;
    tcp::socket& socket = transport_.socket();
    socket.non_blocking(true, ignored);
    socket.send(asio::buffer(bytes.data(), bytes.size()), 0, ignored);
    socket.shutdown(tcp::socket::shutdown_both, ignored);
  }

  void AcceptWebSocket(const WebSocketOptions& options, Done done) override {
    websocket_.emplace(transport_);
    transport_.next_layer().expires_never();
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
            response.set(http::field::sec_websocket_protocol, protocol);
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

  void Read(bool (*is_done)(const void*), ErrorDone done) {
    ReadMessagePart<true>(
        &transport_, &buffer_, &*parser_, is_done,
        [self = shared_from_this(), done = std::move(done)](error_code error) { done(error); });
  }

  void FinishRead(error_code error, const RequestDone& done) {
    http::request<http::string_body>& read = parser_->get();
    request_.method = std::string(read.method_string());
    if (!error) {
      request_.target = std::string(read.target());
      for (const auto& field : read) {
        request_.fields.emplace_back(field.name_string(), field.value());
      }
      request_.body = std::move(read.body());
      request_.keeps_alive = read.keep_alive();
      done(ReadError::kNone, "");
      return;
    }
    const bool is_of_http = error.category() == error_code(http::error::bad_method).category();
    if (!is_of_http || error == http::error::end_of_stream ||
        error == http::error::partial_message) {
      done(ReadError::kEnd, error.message());
    } else if (error == http::error::header_limit) {
      done(ReadError::kLongHeader, error.message());
    } else if (error == http::error::body_limit) {
      done(ReadError::kLongBody, error.message());
    } else {
      done(ReadError::kNoHttpRequest, error.message());
    }
  }

  void Watch() {
    transport_.socket().async_wait(
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
    pollfd watched{.fd = transport_.socket().native_handle(), .events = POLLRDHUP, .revents = 0};
    return poll(&watched, 1, 0) == 1 && (watched.revents & (POLLRDHUP | POLLHUP | POLLERR)) != 0;
  }

  // Loads the next piece of the file. False: it can't be read, or is shorter than before.
  bool ReadFile() {
    answer_.body.resize(static_cast<std::size_t>(
        std::min<std::int64_t>(kPieceBytes, answer_.file.size() - file_offset_)));
    ssize_t size = 0;
    do {
      size =
          pread(answer_.file.descriptor(), answer_.body.data(), answer_.body.size(), file_offset_);
    } while (size < 0 && errno == EINTR);
    if (size <= 0) {
      return false;
    }
    unsent_body_ = asio::buffer(answer_.body.data(), static_cast<std::size_t>(size));
    file_offset_ += size;
    return true;
  }

  // Each piece has its own time limit: a long answer may take long, a stalled reader may not.
  void WriteNext(absl::Duration timeout, Done done) {
    if (unsent_body_.size() == 0 && answer_.file.is_open() && file_offset_ < answer_.file.size() &&
        !ReadFile()) {
      Finish(/*is_ok=*/false, done);
      return;
    }
    if (unsent_head_.size() == 0 && unsent_body_.size() == 0) {
      Finish(/*is_ok=*/true, done);
      return;
    }
    transport_.ExpireAfter(timeout);
    transport_.Write({unsent_head_, unsent_body_},
                     [self = shared_from_this(), timeout, done = std::move(done)](
                         error_code error, std::size_t size) mutable {
                       if (error) {
                         self->Finish(/*is_ok=*/false, done);
                         return;
                       }
                       const std::size_t of_head = std::min(size, self->unsent_head_.size());
                       self->unsent_head_ += of_head;
                       self->unsent_body_ += size - of_head;
                       self->WriteNext(timeout, std::move(done));
                     });
  }

  void Finish(bool is_ok, const Done& done) {
    answer_ = PeerAnswer();
    done(is_ok);
  }

  void Drain(std::function<void()> done) {
    buffer_.clear();
    transport_.Read(
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
  Transport transport_;
  asio::steady_timer timer_;
  asio::steady_timer watch_timer_;

  beast::flat_buffer buffer_{kMaxHeaderBytes + kMaxBodyBytes};
  std::optional<http::request_parser<http::string_body>> parser_;
  PeerRequest request_;
  std::function<void()> on_left_;
  int watch_number_ = 0;  // of the last watch

  PeerAnswer answer_;
  std::string head_;
  asio::const_buffer unsent_head_;
  asio::const_buffer unsent_body_;
  std::int64_t file_offset_ = 0;

  // Compression is off, and its code is not compiled.
  std::optional<websocket::stream<Transport&, /*deflateSupported=*/false>> websocket_;
  beast::flat_buffer message_;
  std::string outgoing_;
};

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
        base::LogWarning("accept_failed", {{"error", error.message()}});
        timer_.expires_after(kAcceptPause);
        timer_.async_wait(ErrorDone([this](error_code waited) {
          if (!waited && acceptor_.is_open()) {
            Accept();
          }
        }));
        return;
      }
      error_code ignored;
      accepted_->set_option(tcp::no_delay(true), ignored);
      serve_(std::make_shared<PeerStreamImpl>(std::move(*accepted_),
                                              tls_ == nullptr ? nullptr : tls_->Get(absl::Now())));
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
  std::vector<std::thread> threads_;
};

absl::Status ToStatus(absl::string_view step, const error_code& error) {
  return error ? absl::UnavailableError(absl::StrCat(step, ": ", error.message()))
               : absl::OkStatus();
}

// Each step is an asynchronous operation that runs alone, because only those can have a time limit.
class Questioner {
 public:
  explicit Questioner(const PeerQuestion& question)
      : question_(question),
        end_(absl::ToChronoTime(absl::Now() + question.timeout)),
        context_(asio::ssl::context::tls_client),
        transport_(io_) {}

  absl::StatusOr<PeerReply> Ask() {
    error_code error;
    const auto found = tcp::resolver(io_).resolve(question_.host, question_.port, error);
    ISOSCOPE_RETURN_IF_ERROR(ToStatus("the name is not known", error));
    ISOSCOPE_RETURN_IF_ERROR(ToStatus("can't connect", Connect(found)));
    if (question_.has_tls) {
      ISOSCOPE_RETURN_IF_ERROR(SetUpTls());
      ISOSCOPE_RETURN_IF_ERROR(ToStatus(
          "no TLS", Run([&](ErrorDone done) {
            transport_.Handshake(&context_, asio::ssl::stream_base::client, std::move(done));
          })));
    }
    // A gateway on the loopback address accepts only names of that address.
    const std::string request = absl::StrCat("GET ", question_.target,
                                             " HTTP/1.1\r\nHost: localhost\r\n"
                                             "Connection: close\r\n\r\n");
    for (asio::const_buffer unsent = asio::buffer(request); unsent.size() > 0;) {
      ISOSCOPE_RETURN_IF_ERROR(ToStatus(
          "can't ask", Run([&](const ErrorDone& done) {
            transport_.Write({unsent}, [&unsent, done](error_code failed, std::size_t size) {
              unsent += size;
              done(failed);
            });
          })));
    }
    beast::flat_buffer buffer;
    http::response_parser<http::string_body> reply;
    reply.body_limit(kMaxReplyBytes);
    reply.eager(true);
    ISOSCOPE_RETURN_IF_ERROR(ToStatus("no answer", Run([&](const ErrorDone& done) {
                                        ReadMessagePart<false>(&transport_, &buffer, &reply,
                                                               &HasWhole<false>, done);
                                      })));
    return PeerReply{.status = static_cast<int>(reply.get().result_int()),
                     .body = std::move(reply.get().body())};
  }

 private:
  // Starts an operation and waits for its end, or for its time limit.
  error_code Run(const std::function<void(ErrorDone)>& start) {
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
      error = Run([&](ErrorDone done) {
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
    if (question_.ca_file.empty()) {
      context_.set_verify_mode(asio::ssl::verify_none);
      return absl::OkStatus();
    }
    error_code error;
    context_.load_verify_file(question_.ca_file, error);
    ISOSCOPE_RETURN_IF_ERROR(ToStatus(question_.ca_file, error));
    context_.set_verify_mode(asio::ssl::verify_peer);
    context_.set_verify_callback(asio::ssl::host_name_verification(question_.host));
    return absl::OkStatus();
  }

  const PeerQuestion& question_;
  const std::chrono::system_clock::time_point end_;
  asio::io_context io_;
  asio::ssl::context context_;
  Transport transport_;
};

}  // namespace

void SetField(absl::string_view name, absl::string_view value, PeerFields* fields) {
  const auto is_named = [&](const auto& field) {
    return absl::EqualsIgnoreCase(field.first, name);
  };
  fields->erase(std::remove_if(fields->begin(), fields->end(), is_named), fields->end());
  fields->emplace_back(name, value);
}

absl::string_view PeerRequest::Field(absl::string_view name) const {
  for (const auto& [found, value] : fields) {
    if (absl::EqualsIgnoreCase(found, name)) {
      return value;
    }
  }
  return "";
}

int PeerRequest::CountFields(absl::string_view name) const {
  return static_cast<int>(std::count_if(fields.begin(), fields.end(), [&](const auto& field) {
    return absl::EqualsIgnoreCase(field.first, name);
  }));
}

AnswerFile::~AnswerFile() {
  if (descriptor_ >= 0) {
    close(descriptor_);
  }
}

absl::StatusOr<AnswerFile> AnswerFile::Open(const std::string& path) {
  const auto failed = [] {
    return absl::InternalError(error_code(errno, boost::system::generic_category()).message());
  };
  AnswerFile file;
  file.descriptor_ = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (file.descriptor_ < 0) {
    return failed();
  }
  struct stat found {};
  if (fstat(file.descriptor_, &found) != 0) {
    return failed();
  }
  posix_fadvise(file.descriptor_, 0, 0, POSIX_FADV_SEQUENTIAL);
  file.size_ = found.st_size;
  return file;
}

std::unique_ptr<PeerListener> PeerListener::Make() { return std::make_unique<PeerListenerImpl>(); }

absl::StatusOr<PeerReply> AskPeer(const PeerQuestion& question) {
  return Questioner(question).Ask();
}

}  // namespace isoscope::gateway
