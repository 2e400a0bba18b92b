// Requests that come in pieces over a real socket, and what is read.

#include "core/http/http_reader.h"

#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"
#include <boost/asio/buffer.hpp>
#include <boost/asio/error.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/error.hpp>
#include <boost/beast/http/error.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/string_body.hpp>

namespace isoscope::http {
namespace {

namespace asio = boost::asio;
namespace beast_http = boost::beast::http;
using asio::ip::tcp;
using boost::system::error_code;

std::string NameOf(ReadError error) {
  static const std::vector<std::string> names = {"read",      "end",           "long header",
                                                 "long body", "wrong version", "no request"};
  return names.at(static_cast<std::size_t>(error));
}

// A connection of this process. The peer sends pieces, each once all before it have been read, and
// then leaves.
class Connection {
 public:
  explicit Connection(std::vector<std::string> pieces) : pieces_(std::move(pieces)) {
    tcp::acceptor acceptor(io_, tcp::endpoint(asio::ip::address_v4::loopback(), 0));
    peer_.connect(acceptor.local_endpoint());
    transport_.emplace(acceptor.accept());
  }

  // Reads a request: header limit 64 bytes, body limit 16. Returns what was read.
  std::string Read() {
    beast_http::request_parser<beast_http::string_body> parser;
    parser.header_limit(64);
    parser.body_limit(16);
    parser.eager(false);
    ReadError error = ReadPart(&parser, MessagePart::kHeader);
    if (error == ReadError::kNone) {
      parser.eager(true);
      error = ReadPart(&parser, MessagePart::kWhole);
    }
    const auto& request = parser.get();
    return error == ReadError::kNone
               ? absl::StrCat(std::string(request.method_string()), " ",
                              std::string(request.target()), " ", request.body())
               : NameOf(error);
  }

 private:
  ReadError ReadPart(beast_http::request_parser<beast_http::string_body>* parser,
                     MessagePart part) {
    std::optional<error_code> result;
    ReadMessagePart<true>(&*transport_, &buffer_, parser, part,
                          [&](error_code error) { result = error; });
    EXPECT_FALSE(result.has_value()) << "it never calls back from the call itself";
    while (!result.has_value()) {
      io_.restart();
      if (io_.poll() == 0 && !result.has_value()) {
        Send();
        io_.run_one();
      }
    }
    return ReadErrorOf(*result);
  }
  void Send() {
    if (next_ < pieces_.size()) {
      asio::write(peer_, asio::buffer(pieces_[next_++]));
    } else {
      peer_.close();
    }
  }

  const std::vector<std::string> pieces_;
  std::size_t next_ = 0;
  asio::io_context io_;
  tcp::socket peer_{io_};
  std::optional<Transport> transport_;
  boost::beast::flat_buffer buffer_{128};
};

TEST(HttpReaderTest, RequestsAreReadFromPiecesOfAnySize) {
  const std::string post = "POST /a HTTP/1.1\r\nContent-Length: 4\r\n\r\nbody";
  const std::string get = "GET /b HTTP/1.1\r\n\r\n";
  for (std::size_t cut = 0; cut < post.size(); ++cut) {
    Connection connection({post.substr(0, cut + 1), post.substr(cut + 1) + get});
    EXPECT_EQ(connection.Read(), "POST /a body") << cut;
    EXPECT_EQ(connection.Read(), "GET /b ") << cut;
    EXPECT_EQ(connection.Read(), "end") << cut;
  }
}

TEST(HttpReaderTest, EachWrongRequestIsNamed) {
  struct Case {
    std::string bytes;
    std::string read;
  };
  const std::vector<Case> cases = {
      {"", "end"},
      {"GET / HT", "end"},
      {"POST / HTTP/1.1\r\nContent-Length: 4\r\n\r\nbo", "end"},
      {absl::StrCat("GET / HTTP/1.1\r\nA: ", std::string(60, 'a'), "\r\n\r\n"), "long header"},
      {absl::StrCat("GET /", std::string(120, 'a')), "long header"},
      {absl::StrCat("POST / HTTP/1.1\r\nContent-Length: 17\r\n\r\n", std::string(17, 'a')),
       "long body"},
      {"GET / HTTP/2.0\r\n\r\n", "wrong version"},
      {"GET / SPDY/9\r\n\r\n", "wrong version"},
      {"GET /\r\n\r\n", "no request"},
      {std::string("\0\1\2\3\r\n\r\n", 8), "no request"},
      {"GET / HTTP/1.1\r\nno field\r\n\r\n", "no request"},
  };
  for (const Case& c : cases) {
    Connection connection(c.bytes.empty() ? std::vector<std::string>{}
                                          : std::vector<std::string>{c.bytes});
    EXPECT_EQ(connection.Read(), c.read) << c.bytes;
  }
}

TEST(ReadErrorTest, ErrorsOfTheConnectionAreItsEnd) {
  struct Case {
    error_code error;
    ReadError read;
  };
  const std::vector<Case> cases = {
      {{}, ReadError::kNone},
      {asio::error::eof, ReadError::kEnd},
      {asio::error::connection_reset, ReadError::kEnd},
      {boost::beast::error::timeout, ReadError::kEnd},
      {beast_http::error::end_of_stream, ReadError::kEnd},
      {beast_http::error::partial_message, ReadError::kEnd},
      {beast_http::error::header_limit, ReadError::kLongHeader},
      {beast_http::error::body_limit, ReadError::kLongBody},
      {beast_http::error::buffer_overflow, ReadError::kNoHttpRequest},
      {beast_http::error::bad_version, ReadError::kWrongVersion},
      {beast_http::error::bad_field, ReadError::kNoHttpRequest},
  };
  for (const Case& c : cases) {
    EXPECT_EQ(ReadErrorOf(c.error), c.read) << c.error.message();
  }
}

}  // namespace
}  // namespace isoscope::http
