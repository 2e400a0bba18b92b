// A browser's connection: HTTP/1.1 and WebSockets, over TCP or TLS. Boost.Asio and Boost.Beast
// compile slowly, so no header that others include has their templates.

#ifndef ISOSCOPE_CORE_HTTP_PEER_STREAM_H_
#define ISOSCOPE_CORE_HTTP_PEER_STREAM_H_

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "absl/strings/string_view.h"
#include "absl/time/time.h"

#include "core/http/peer_message.h"

namespace boost::asio::ssl {
class context;
}  // namespace boost::asio::ssl

namespace isoscope::http {

class Transport;

// The reason that no request came.
enum class ReadError {
  kNone,
  kEnd,            // the peer left, or the time limit passed
  kLongHeader,     // longer than kMaxHeaderBytes
  kLongBody,       // longer than kMaxBodyBytes
  kWrongVersion,   // HTTP, but not HTTP/1.0 or HTTP/1.1
  kNoHttpRequest,  // no HTTP/1.1
};

// How slowly a peer may take an answer.
struct WriteLimits {
  absl::Duration piece_timeout;  // for each piece, as the socket takes it
  // On average, after `piece_timeout`. So nobody holds a connection by taking a byte at a time.
  double min_bytes_per_second = 4 * 1024;
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

  // `context`: of TLS; null without.
  static std::shared_ptr<PeerStream> Make(std::unique_ptr<Transport> transport,
                                          std::shared_ptr<boost::asio::ssl::context> context);
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
  // Reads the header of a request into request(). Its first byte must come within `idle_timeout`,
  // the rest within `header_timeout` from then on. The message describes an error in the request.
  virtual void ReadHeader(absl::Duration idle_timeout, absl::Duration header_timeout,
                          RequestDone done) = 0;
  // Reads the body that follows, within `timeout`.
  virtual void ReadBody(absl::Duration timeout, RequestDone done) = 0;
  // Tells a client that waits for it that its body may come (100), unless the body comes already.
  virtual void WriteContinue(absl::Duration timeout, Done done) = 0;
  virtual PeerRequest* request() = 0;
  // Calls `on_left` once if the peer leaves before StopWatch. REQUIRES: no other operation is
  // pending.
  virtual void WatchPeer(std::function<void()> on_left) = 0;
  virtual void StopWatch() = 0;
  virtual void WriteAnswer(PeerAnswer answer, const WriteLimits& limits, Done done) = 0;
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

}  // namespace isoscope::http

#endif  // ISOSCOPE_CORE_HTTP_PEER_STREAM_H_
