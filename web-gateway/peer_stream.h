// The transport of a gateway: browsers' connections, HTTP/1.1 and WebSockets on them, over TCP or
// TLS; and the same for one question to another gateway. Boost.Asio and Boost.Beast take long to
// compile, so peer_stream.cc alone sees their templates.

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

// Adds a field at the end, in place of those of its name; names have no case.
void SetField(absl::string_view name, absl::string_view value, PeerFields* fields);

struct PeerRequest {
  std::string method;
  std::string target;
  PeerFields fields;
  std::string body;
  bool keeps_alive = false;     // another request may follow
  bool asks_websocket = false;  // to go on as a WebSocket

  // The first value of a field; "" without it.
  [[nodiscard]] absl::string_view Field(absl::string_view name) const;
  [[nodiscard]] int CountFields(absl::string_view name) const;
};

// Why no request came.
enum class ReadError {
  kNone,
  kEnd,            // the peer left, or the time has passed
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
  PeerFields fields = {};  // all of them, Content-Length too
  std::string body = {};
  AnswerFile file = {};  // in place of `body`, if it is open
};

struct WebSocketOptions {
  absl::Duration handshake_timeout;
  absl::Duration idle_timeout;  // the most silence of a peer, which answers pings
  std::size_t max_message_bytes = 0;
  std::string protocol = {};  // the subprotocol that both speak; empty: none
};

// A connection. Its operations end in calls on its strand, in which all its other functions are
// called too, but for Post, which is thread-safe. One operation of a kind runs at a time. A pending
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
  // The peer's; a socket that is closed has 0.0.0.0.
  [[nodiscard]] virtual std::string RemoteAddress() const = 0;
  // Calls `task` after a time, unless the timer is set again or cancelled before.
  virtual void SetTimer(absl::Duration time, std::function<void()> task) = 0;
  virtual void CancelTimer() = 0;
  // Closes the socket: what is under way ends.
  virtual void CloseSocket() = 0;

  // HTTP. Each operation has a time, after which it fails.

  // REQUIRES: has_tls().
  virtual void Handshake(absl::Duration timeout, Done done) = 0;
  // Reads a request into request(). It must begin, up to the end of its header, within
  // `header_timeout`, and its body come within `body_timeout`. One that asks for a WebSocket has
  // no body. The message says what is wrong with the request.
  virtual void ReadRequest(absl::Duration header_timeout, absl::Duration body_timeout,
                           RequestDone done) = 0;
  virtual PeerRequest* request() = 0;
  // Calls `on_left` once if the peer leaves before StopWatch. Nothing else is under way.
  virtual void WatchPeer(std::function<void()> on_left) = 0;
  virtual void StopWatch() = 0;
  // `piece_timeout`: in which the peer must take a piece of the answer.
  virtual void WriteAnswer(PeerAnswer answer, absl::Duration piece_timeout, Done done) = 0;
  // Tells the peer that no more comes. `has_unread_bytes`: the peer may still send, and what it
  // sends is read for at most `timeout`: a socket that is closed with unread bytes takes the answer
  // back. The socket closes with the stream.
  virtual void End(bool has_unread_bytes, absl::Duration timeout, std::function<void()> done) = 0;
  // Sends what has room in the buffer of a new socket, and ends the connection. REQUIRES:
  // !has_tls().
  virtual void Refuse(absl::string_view bytes) = 0;

  // WebSocket.

  // Answers request(), which asks for it. No operation of HTTP follows.
  virtual void AcceptWebSocket(const WebSocketOptions& options, Done done) = 0;
  // Reads a message into message(). False: the connection has ended, or is broken.
  virtual void ReadMessage(Done done) = 0;
  [[nodiscard]] virtual absl::string_view message() const = 0;  // until the next ReadMessage
  [[nodiscard]] virtual bool is_text() const = 0;
  // Writes a binary message.
  virtual void WriteMessage(std::string message, Done done) = 0;
  // Says goodbye with a code of RFC 6455 and at most kMaxReasonBytes, and waits for the peer's.
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
  // Ends the threads, and drops the connections that are left.
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
  std::string ca_file = {};  // who must have signed the certificate; empty: any will do
  absl::Duration timeout;
};

struct PeerReply {
  int status = 0;
  std::string body;
};

// GETs a target of "localhost" from a server. UNAVAILABLE says which step failed. Blocks.
absl::StatusOr<PeerReply> AskPeer(const PeerQuestion& question);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_PEER_STREAM_H_
