// Reads messages of HTTP/1.1 from a transport, as Beast's own loop would: it is compiled for one
// stream and one handler (transport.h).

#ifndef ISOSCOPE_CORE_HTTP_HTTP_READER_H_
#define ISOSCOPE_CORE_HTTP_HTTP_READER_H_

#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/basic_parser.hpp>

#include "core/http/peer_stream.h"
#include "core/http/transport.h"

namespace isoscope::http {

enum class MessagePart { kHeader, kWhole };

// Parses until the parser has that part, and reads the bytes for it. The buffer keeps the rest.
// Calls `done` once, on the transport's executor; all arguments live until then.
template <bool is_request>
void ReadMessagePart(Transport* transport, boost::beast::flat_buffer* buffer,
                     boost::beast::http::basic_parser<is_request>* parser, MessagePart part,
                     const ErrorDone& done, bool has_read = false);
extern template void ReadMessagePart<true>(Transport*, boost::beast::flat_buffer*,
                                           boost::beast::http::basic_parser<true>*, MessagePart,
                                           const ErrorDone&, bool);
extern template void ReadMessagePart<false>(Transport*, boost::beast::flat_buffer*,
                                            boost::beast::http::basic_parser<false>*, MessagePart,
                                            const ErrorDone&, bool);

// Returns what an error of ReadMessagePart means for the connection.
ReadError ReadErrorOf(const boost::system::error_code& error);

}  // namespace isoscope::http

#endif  // ISOSCOPE_CORE_HTTP_HTTP_READER_H_
