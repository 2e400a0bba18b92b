#include "core/http/transport.h"

#include <boost/beast/websocket/teardown.hpp>

namespace isoscope::http {

void Transport::Handshake(boost::asio::ssl::context* context,
                          boost::asio::ssl::stream_base::handshake_type type, ErrorDone done) {
  tls_.emplace(tcp_, *context);
  tls_->async_handshake(type, std::move(done));
}

void Transport::Shutdown(ErrorDone done) { tls_->async_shutdown(std::move(done)); }

void Transport::Read(boost::asio::mutable_buffer buffer, IoDone done) {
  if (tls_) {
    tls_->async_read_some(buffer, std::move(done));
  } else {
    tcp_.async_read_some(buffer, std::move(done));
  }
}

void Transport::Write(const WriteBuffers& buffers, IoDone done) {
  if (tls_) {
    tls_->async_write_some(buffers, std::move(done));
  } else {
    tcp_.async_write_some(buffers, std::move(done));
  }
}

void teardown(boost::beast::role_type role, Transport& transport,
              boost::system::error_code& error) {
  boost::beast::websocket::teardown(role, transport.socket(), error);
}

void Transport::TearDown(boost::beast::role_type role, ErrorDone done) {
  if (tls_) {
    Shutdown(std::move(done));
  } else {
    boost::beast::websocket::async_teardown(role, socket(), std::move(done));
  }
}

}  // namespace isoscope::http
