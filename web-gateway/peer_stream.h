// The transport of a gateway: browsers' connections, HTTP/1.1 and WebSockets on them, over TCP or
// TLS. It also sends a single request to another gateway. Boost.Asio and Boost.Beast compile
// slowly, so only peer_stream.cc includes their templates.

#ifndef ISOSCOPE_WEB_GATEWAY_PEER_STREAM_H_
#define ISOSCOPE_WEB_GATEWAY_PEER_STREAM_H_

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

#include "web-gateway/tls_context.h"

namespace isoscope::gateway {

// Names and values of a header, in order.
using PeerFields = std::vector<std::pair<std::string, std::string>>;

// Appends a field, after removing those of the same name; names ignore case.
void SetField(absl::string_view name, absl::string_view value, PeerFields* fields);

struct PeerRequest {
  std::string method;
  std::string target;
  PeerFields fields;
  std::string body;
  bool keeps_alive = false;     // another request may follow
  bool asks_websocket = false;  // requests a WebSocket

  // Returns the first value of a field; "" without it.
  [[nodiscard]] absl::string_view Field(absl::string_view name) const;
  [[nodiscard]] int CountFields(absl::string_view name) const;
};

// The reason why no request came.
enum class ReadError {
  kNone,
  kEnd,            // the peer left, or the time limit passed
  kLongHeader,     // longer than kMaxHeaderBytes
  kLongBody,       // longer than kMaxBodyBytes
  kNoHttpRequest,  // no HTTP/1.1
};

// An open file; closes it. Can be moved.
class AnswerFile {
 public:
  AnswerFile() = default;
  ~AnswerFile();
  AnswerFile(AnswerFile&& other) noexcept
      : descriptor_(std::exchange(other.descriptor_, -1)), size_(other.size_) {}
  AnswerFile& operator=(AnswerFile&& other) noexcept {
    std::swap(descriptor_, other.descriptor_);
    std::swap(size_, other.size_);
    return *this;
  }

  // The status has the error of the operating system as its message.
  static absl::StatusOr<AnswerFile> Open(const std::string& path);

  [[nodiscard]] bool is_open() const { return descriptor_ >= 0; }
  [[nodiscard]] int descriptor() const { return descriptor_; }
  [[nodiscard]] std::int64_t size() const { return size_; }

 private:
  int descriptor_ = -1;
  std::int64_t size_ = 0;
};

struct PeerAnswer {
  int status = 200;
  PeerFields fields = {};  // complete, with Content-Length
  std::string body = {};
  AnswerFile file = {};  // replaces `body` if it is open
};

struct WebSocketOptions {
  absl::Duration handshake_timeout;
  absl::Duration idle_timeout;  // longest silence of a peer, which answers pings
  std::size_t max_message_bytes = 0;
  std::string protocol = {};  // subprotocol of both sides; empty: none
};

// A connection. Its operations end in calls on its strand. All other functions must be called
// there, except Post, which is thread-safe. One operation of a kind runs at a time. A pending
// operation keeps the stream alive.
class PeerStream {
 public:
  static constexpr std::uint32_t kMaxHeaderBytes = 16 * 1024;
  static constexpr std::uint64_t kMaxBodyBytes = std::uint64_t{1024} * 1024;

  using Done = std::function<void(bool is_ok)>;
  using RequestDone = std::function<void(ReadError error, const std::string& message)>;

  virtual ~PeerStream() = default;

  // Calls `task` on the strand.
  virtual void Post(std::function<void()> task) = 0;
  [[nodiscard]] virtual bool has_tls() const = 0;
  // Returns the peer's address; 0.0.0.0 once the socket is closed.
  [[nodiscard]] virtual std::string RemoteAddress() const = 0;
  // Calls `task` after a delay, unless the timer is set again or cancelled before.
  virtual void SetTimer(absl::Duration time, std::function<void()> task) = 0;
  virtual void CancelTimer() = 0;
  // Closes the socket: pending operations end.
  virtual void CloseSocket() = 0;

  // HTTP. Each operation has a time limit, after which it fails.

  // REQUIRES: has_tls().
  virtual void Handshake(absl::Duration timeout, Done done) = 0;
  // Reads a request into request(). Its header must be complete within `header_timeout`, its body
  // within `body_timeout`. A request for a WebSocket has no body. The message describes an error in
  // the request.
  virtual void ReadRequest(absl::Duration header_timeout, absl::Duration body_timeout,
                           RequestDone done) = 0;
  virtual PeerRequest* request() = 0;
  // Calls `on_left` once if the peer leaves before StopWatch. REQUIRES: no other operation is
  // pending.
  virtual void WatchPeer(std::function<void()> on_left) = 0;
  virtual void StopWatch() = 0;
  // `piece_timeout`: the peer must take each piece of the answer within it.
  virtual void WriteAnswer(PeerAnswer answer, absl::Duration piece_timeout, Done done) = 0;
  // Tells the peer that no more data comes. `has_unread_bytes`: the peer may still send, and its
  // bytes are read for at most `timeout`. A socket closed with unread bytes may drop the answer.
  // The socket closes with the stream.
  virtual void End(bool has_unread_bytes, absl::Duration timeout, std::function<void()> done) = 0;
  // Sends the bytes that fit into the buffer of a new socket, and ends the connection. REQUIRES:
  // !has_tls().
  virtual void Refuse(absl::string_view bytes) = 0;

  // WebSocket.

  // Accepts request(), which asks for a WebSocket. No operation of HTTP follows.
  virtual void AcceptWebSocket(const WebSocketOptions& options, Done done) = 0;
  // Reads a message into message(). False: the connection has ended, or is broken.
  virtual void ReadMessage(Done done) = 0;
  [[nodiscard]] virtual absl::string_view message() const = 0;  // until the next ReadMessage
  [[nodiscard]] virtual bool is_text() const = 0;
  // Writes a binary message.
  virtual void WriteMessage(std::string message, Done done) = 0;
  // Sends a close with a code of RFC 6455 and at most kMaxReasonBytes, and waits for the peer's.
  virtual void CloseWebSocket(std::uint16_t code, absl::string_view reason,
                              std::function<void()> done) = 0;
  static constexpr std::size_t kMaxReasonBytes = 123;
};

// The listening socket and the threads of connections.
class PeerListener {
 public:
  // Called for each connection, one at a time; a stream that it does not keep is closed.
  using Serve = std::function<void(std::shared_ptr<PeerStream> stream)>;

  static std::unique_ptr<PeerListener> Make();
  // Ends the threads, and drops the remaining connections.
  virtual ~PeerListener() = default;

  // `host` has no brackets; port 0 takes a free one. `address`: both, for errors. `tls`: null for
  // plain TCP. UNAVAILABLE: the address can't be bound. Call it once.
  virtual absl::Status Listen(const std::string& host, const std::string& port,
                              const std::string& address, std::unique_ptr<TlsContext> tls,
                              int thread_count, Serve serve) = 0;
  [[nodiscard]] virtual int port() const = 0;
  // Takes no new connections.
  virtual void Close() = 0;
};

struct PeerQuestion {
  std::string host;
  std::string port;
  std::string target;
  bool has_tls = false;
  std::string ca_file = {};  // authority of the certificate; empty: any
  absl::Duration timeout;
};

struct PeerReply {
  int status = 0;
  std::string body;
};

// Sends GET for a target of "localhost" to a server. UNAVAILABLE names the step that failed.
// Blocks.
absl::StatusOr<PeerReply> AskPeer(const PeerQuestion& question);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_PEER_STREAM_H_
