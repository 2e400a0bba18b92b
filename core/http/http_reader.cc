#include "core/http/http_reader.h"

#include <boost/asio/error.hpp>
#include <boost/asio/post.hpp>
#include <boost/beast/core/read_size.hpp>
#include <boost/beast/http/error.hpp>

namespace isoscope::http {

namespace beast = boost::beast;
namespace beast_http = beast::http;
using boost::system::error_code;

template <bool is_request>
void ReadMessagePart(Transport* transport, beast::flat_buffer* buffer,
                     beast_http::basic_parser<is_request>* parser, MessagePart part,
                     const ErrorDone& done, bool has_read) {
  constexpr std::size_t kMaxReadBytes = std::size_t{64} * 1024;  // from a socket at a time
  const auto is_done = [&] {
    return part == MessagePart::kHeader ? parser->is_header_done() : parser->is_done();
  };
  error_code error;
  while (!is_done() && buffer->size() > 0 && !error) {
    buffer->consume(parser->put(buffer->data(), error));
  }
  if (error == beast_http::error::need_more) {
    error = {};
  }
  if (error || is_done()) {
    if (has_read) {
      done(error);
    } else {
      boost::asio::post(transport->get_executor(), [done, error] { done(error); });
    }
    return;
  }
  const std::size_t size = beast::read_size(*buffer, kMaxReadBytes);
  if (size == 0) {
    done(beast_http::error::buffer_overflow);
    return;
  }
  transport->Read(buffer->prepare(size), [=](error_code failed, std::size_t read) {
    buffer->commit(read);
    if (!failed) {
      ReadMessagePart(transport, buffer, parser, part, done, /*has_read=*/true);
      return;
    }
    if (failed == boost::asio::error::eof) {
      failed = {};
      if (parser->got_some()) {
        parser->put_eof(failed);
      } else {
        failed = beast_http::error::end_of_stream;
      }
    }
    done(failed);
  });
}

template void ReadMessagePart<true>(Transport*, beast::flat_buffer*,
                                    beast_http::basic_parser<true>*, MessagePart, const ErrorDone&,
                                    bool);
template void ReadMessagePart<false>(Transport*, beast::flat_buffer*,
                                     beast_http::basic_parser<false>*, MessagePart,
                                     const ErrorDone&, bool);

ReadError ReadErrorOf(const error_code& error) {
  if (!error) {
    return ReadError::kNone;
  }
  const bool is_of_http = error.category() == error_code(beast_http::error::bad_method).category();
  if (!is_of_http || error == beast_http::error::end_of_stream ||
      error == beast_http::error::partial_message) {
    return ReadError::kEnd;
  }
  return error == beast_http::error::header_limit  ? ReadError::kLongHeader
         : error == beast_http::error::body_limit  ? ReadError::kLongBody
         : error == beast_http::error::bad_version ? ReadError::kWrongVersion
                                                   : ReadError::kNoHttpRequest;
}

}  // namespace isoscope::http
