// The bytes of a connection, over TCP or TLS.
//
// Asio and Beast are templates over streams and handlers, and each pair is compiled anew. So there
// is one stream, Transport, and its operations take handlers of one type, IoDone; the handlers of
// Beast's WebSocket are wrapped in that type.
//
// They compile slowly, so only sources include this header.

#ifndef ISOSCOPE_CORE_HTTP_TRANSPORT_H_
#define ISOSCOPE_CORE_HTTP_TRANSPORT_H_

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <type_traits>
#include <utility>

#include "absl/time/time.h"
#include <boost/asio/buffer.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/ssl/stream.hpp>
#include <boost/beast/core/role.hpp>
#include <boost/beast/core/tcp_stream.hpp>

namespace isoscope::http {

using ErrorDone = std::function<void(boost::system::error_code)>;
using IoDone = std::function<void(boost::system::error_code, std::size_t)>;
// The most buffers of a sequence that one write takes. The rest follows in further writes.
using WriteBuffers = std::array<boost::asio::const_buffer, 4>;

// TCP, with or without TLS on it; a stream as Asio understands them. Belongs to the strand of its
// socket.
class Transport {
 public:
  using next_layer_type = boost::beast::tcp_stream;
  using executor_type = next_layer_type::executor_type;
  using Socket = boost::asio::ip::tcp::socket;

  explicit Transport(Socket socket) : tcp_(std::move(socket)) {}
  explicit Transport(boost::asio::io_context& io) : tcp_(io) {}

  executor_type get_executor() { return tcp_.get_executor(); }
  next_layer_type& next_layer() { return tcp_; }
  [[nodiscard]] const next_layer_type& next_layer() const { return tcp_; }
  Socket& socket() { return tcp_.socket(); }
  void ExpireAfter(absl::Duration time) { tcp_.expires_after(absl::ToChronoMilliseconds(time)); }

  // Puts TLS on the connection. `context` outlives the transport.
  void Handshake(boost::asio::ssl::context* context,
                 boost::asio::ssl::stream_base::handshake_type type, ErrorDone done);
  // Sends TLS's close_notify and waits for the peer's, so that the peer can tell an end from a cut.
  // REQUIRES: Handshake. Most errors mean that the peer has just closed.
  void Shutdown(ErrorDone done);

  void Read(boost::asio::mutable_buffer buffer, IoDone done);
  void Write(const WriteBuffers& buffers, IoDone done);

  // Beast requires these.
  template <typename Buffers, typename Handler>
  void async_read_some(const Buffers& buffers, Handler&& handler) {
    boost::asio::mutable_buffer first;
    for (auto it = boost::asio::buffer_sequence_begin(buffers);
         it != boost::asio::buffer_sequence_end(buffers) && first.size() == 0; ++it) {
      first = *it;
    }
    Read(first, Erase(std::forward<Handler>(handler)));
  }
  template <typename Buffers, typename Handler>
  void async_write_some(const Buffers& buffers, Handler&& handler) {
    WriteBuffers some;
    std::size_t count = 0;
    for (auto it = boost::asio::buffer_sequence_begin(buffers);
         it != boost::asio::buffer_sequence_end(buffers) && count < some.size(); ++it) {
      const boost::asio::const_buffer buffer = *it;
      if (buffer.size() > 0) {
        some.at(count++) = buffer;
      }
    }
    Write(some, Erase(std::forward<Handler>(handler)));
  }
  // A WebSocket calls it after its close. Beast finds it by its name.
  friend void teardown(boost::beast::role_type role, Transport& transport,
                       boost::system::error_code& error);
  template <typename Handler>
  friend void async_teardown(boost::beast::role_type role, Transport& transport,
                             Handler&& handler) {
    const auto held = std::make_shared<std::decay_t<Handler>>(std::forward<Handler>(handler));
    transport.TearDown(role, [held](boost::system::error_code error) { std::move (*held)(error); });
  }

 private:
  // Beast's handlers can't be copied, and have many types.
  template <typename Handler>
  static IoDone Erase(Handler&& handler) {
    return
        [held = std::make_shared<std::decay_t<Handler>>(std::forward<Handler>(handler))](
            boost::system::error_code error, std::size_t size) { std::move (*held)(error, size); };
  }
  void TearDown(boost::beast::role_type role, ErrorDone done);

  boost::beast::tcp_stream tcp_;
  std::optional<boost::asio::ssl::stream<boost::beast::tcp_stream&>> tls_;
};

}  // namespace isoscope::http

#endif  // ISOSCOPE_CORE_HTTP_TRANSPORT_H_
