// A browser's connection: TCP, with or without TLS on it. One type for both, so that HTTP and
// WebSockets are written once. It is a stream as Boost.Asio understands them.

#ifndef ISOSCOPE_WEB_GATEWAY_PEER_STREAM_H_
#define ISOSCOPE_WEB_GATEWAY_PEER_STREAM_H_

#include <cstddef>
#include <memory>
#include <utility>

#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/ssl/stream.hpp>
#include <boost/beast/core/role.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/websocket/teardown.hpp>

namespace isoscope::gateway {

// Thread-compatible: belongs to the strand of its socket. Can be moved between operations.
class PeerStream {
 public:
  using next_layer_type = boost::beast::tcp_stream;
  using executor_type = next_layer_type::executor_type;

  // `context`: null for plain TCP.
  PeerStream(boost::asio::ip::tcp::socket socket,
             std::shared_ptr<boost::asio::ssl::context> context)
      : context_(std::move(context)),
        tcp_(std::make_unique<boost::beast::tcp_stream>(std::move(socket))) {
    if (context_ != nullptr) {
      tls_ =
          std::make_unique<boost::asio::ssl::stream<boost::beast::tcp_stream&>>(*tcp_, *context_);
    }
  }

  executor_type get_executor() { return tcp_->get_executor(); }
  next_layer_type& next_layer() { return *tcp_; }
  [[nodiscard]] const next_layer_type& next_layer() const { return *tcp_; }
  [[nodiscard]] bool has_tls() const { return tls_ != nullptr; }

  // REQUIRES: has_tls(). `handler`: takes the error.
  template <typename Handler>
  void AsyncHandshake(Handler&& handler) {
    tls_->async_handshake(boost::asio::ssl::stream_base::server, std::forward<Handler>(handler));
  }

  // Says goodbye in TLS and waits for the peer's, so that it can tell an end from a cut. REQUIRES:
  // has_tls(). `handler`: takes the error, most often that the peer has just closed.
  template <typename Handler>
  void AsyncShutdown(Handler&& handler) {
    tls_->async_shutdown(std::forward<Handler>(handler));
  }

  template <typename Buffers, typename Handler>
  auto async_read_some(const Buffers& buffers, Handler&& handler) {
    return tls_ != nullptr ? tls_->async_read_some(buffers, std::forward<Handler>(handler))
                           : tcp_->async_read_some(buffers, std::forward<Handler>(handler));
  }
  template <typename Buffers, typename Handler>
  auto async_write_some(const Buffers& buffers, Handler&& handler) {
    return tls_ != nullptr ? tls_->async_write_some(buffers, std::forward<Handler>(handler))
                           : tcp_->async_write_some(buffers, std::forward<Handler>(handler));
  }

 private:
  std::shared_ptr<boost::asio::ssl::context> context_;  // outlives tls_
  std::unique_ptr<boost::beast::tcp_stream> tcp_;       // on the heap: tls_ refers to it
  std::unique_ptr<boost::asio::ssl::stream<boost::beast::tcp_stream&>> tls_;
};

// What a WebSocket does with its stream once it has closed. Found by Beast through the name.
inline void teardown(boost::beast::role_type role, PeerStream& stream,
                     boost::system::error_code& error) {
  boost::beast::websocket::teardown(role, stream.next_layer().socket(), error);
}
template <typename Handler>
void async_teardown(boost::beast::role_type role, PeerStream& stream, Handler&& handler) {
  if (stream.has_tls()) {
    stream.AsyncShutdown(std::forward<Handler>(handler));
    return;
  }
  boost::beast::websocket::async_teardown(role, stream.next_layer().socket(),
                                          std::forward<Handler>(handler));
}

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_PEER_STREAM_H_
