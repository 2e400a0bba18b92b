// The gateway as browsers meet it beyond this machine: https, wss, and users' tokens that the
// coordinator knows. Real processes; certificates made by openssl.

#include <cstdint>
#include <cstdlib>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/ssl/error.hpp>
#include <boost/asio/ssl/host_name_verification.hpp>
#include <boost/asio/ssl/stream.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/http/write.hpp>
#include <boost/beast/websocket/ssl.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <openssl/sha.h>

#include "core/base/monotonic_time.h"
#include "core/io/file.h"
#include "tests/support/certificates.h"
#include "tests/support/process.h"
#include "tests/support/process_cluster.h"
#include "tests/support/raw_connection.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using asio::ip::tcp;
using boost::system::error_code;
using ::testing::AnyOf;
using testing::FlagsOf;
using ::testing::HasSubstr;
using testing::kPatience;
using ::testing::Not;
using testing::ServerProcess;
using testing::TestAuthority;
using Flags = std::vector<std::string>;
using Response = http::response<http::string_body>;

constexpr char kRender[] = "/v1/datasets/gyroid/render?isovalue=128&width=96&height=80";

Flags operator+(Flags left, const Flags& right) {
  left.insert(left.end(), right.begin(), right.end());
  return left;
}

std::string HeaderOf(const Response& response, const std::string& name) {
  const auto value = response[name];
  return std::string(value.data(), value.size());
}

// A blocking TLS connection to "127.0.0.1:PORT" that checks the certificate.
class SecureConnection {
 public:
  SecureConnection(const std::string& address, const std::string& ca_file,
                   const std::string& server_name = "127.0.0.1")
      : context_(asio::ssl::context::tls_client), stream_(io_, context_) {
    context_.load_verify_file(ca_file);
    stream_.set_verify_mode(asio::ssl::verify_peer);
    stream_.set_verify_callback(asio::ssl::host_name_verification(server_name));
    const std::vector<std::string> parts = absl::StrSplit(address, ':');
    tcp::resolver resolver(io_);
    asio::connect(stream_.next_layer(), resolver.resolve(parts[0], parts[1]));
    stream_.handshake(asio::ssl::stream_base::client, error_);
  }

  [[nodiscard]] const error_code& error() const { return error_; }
  Response Get(const std::string& target, const std::string& authorization = "") {
    http::request<http::string_body> request(http::verb::get, target, 11);
    request.set(http::field::host, "127.0.0.1");
    if (!authorization.empty()) {
      request.set(http::field::authorization, authorization);
    }
    http::write(stream_, request, error_);
    beast::flat_buffer buffer;
    http::response_parser<http::string_body> parser;
    parser.body_limit(std::uint64_t{1} << 30);
    http::read(stream_, buffer, parser, error_);
    EXPECT_FALSE(error_) << error_.message();
    return parser.release();
  }
  asio::ssl::stream<tcp::socket>& stream() { return stream_; }

 private:
  asio::io_context io_;
  asio::ssl::context context_;
  asio::ssl::stream<tcp::socket> stream_;
  error_code error_;
};

class GatewayTlsTest : public ::testing::Test {
 protected:
  void SetUp() override {
    for (const char* name : {"gyroid", "secret"}) {
      ISOSCOPE_ASSERT_OK(testing::MakeDataset(name == std::string("secret")
                                                  ? testing::BallVolume({33, 29, 31}, 0.7)
                                                  : testing::GyroidVolume({41, 35, 29}),
                                              folder_.Sub(name), 1, 8));
    }
    unsigned char digest[SHA256_DIGEST_LENGTH];
    SHA256(reinterpret_cast<const unsigned char*>("user"), 4, digest);
    ISOSCOPE_ASSERT_OK(io::WriteWholeFile(
        folder_.Sub("tokens.json"),
        absl::StrCat(R"({"tokens": [{"name": "u", "datasets": ["gyroid"], "sha256": ")",
                     absl::BytesToHexString(
                         absl::string_view(reinterpret_cast<const char*>(digest), sizeof(digest))),
                     R"("}]})")));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        agent_, testing::StartAgent({testing::ShardDirectory(folder_.Sub("gyroid"), 0, 1),
                                     testing::ShardDirectory(folder_.Sub("secret"), 0, 1)},
                                    "127.0.0.1:0", FlagsOf(authority_.IssueRole("agent"))));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        coordinator_, testing::StartCoordinator({agent_.address},
                                                FlagsOf(authority_.IssueRole("coordinator")) +
                                                    Flags{"--tokens", folder_.Sub("tokens.json")}));
    gateway_flags_ = FlagsOf(authority_.IssueRole("gateway"));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        gateway_,
        testing::StartGateway(coordinator_.address, gateway_flags_ + Flags{"--user-tokens"}));
  }

  Response Get(const std::string& target, const std::string& authorization = "") {
    return SecureConnection(gateway_.address, authority_.ca_file()).Get(target, authorization);
  }

  testing::TempDir folder_;
  TestAuthority authority_;
  Flags gateway_flags_;
  ServerProcess agent_;
  ServerProcess coordinator_;
  ServerProcess gateway_;
};

TEST_F(GatewayTlsTest, UsersHaveTheRightsOfTheirTokens) {
  EXPECT_EQ(Get("/healthz").body(), "ok\n");
  EXPECT_EQ(Get("/").result_int(), 200U);
  for (const char* target : {"/v1/datasets", "/v1/status", "/v1/datasets/gyroid", kRender}) {
    EXPECT_EQ(Get(target).result_int(), 401U) << target;
    EXPECT_EQ(Get(target, "Bearer wrong").result_int(), 401U) << target;
    const Response allowed = Get(target, "Bearer user");
    EXPECT_EQ(allowed.result_int(), 200U) << target << allowed.body();
    EXPECT_THAT(allowed.body(), Not(HasSubstr("secret"))) << target;
  }
  EXPECT_EQ(Get("/v1/datasets?token=user").result_int(), 200U);
  EXPECT_EQ(Get("/v1/datasets/secret", "Bearer user").result_int(), 404U);
  EXPECT_EQ(Get("/v1/datasets/secret/render?isovalue=128", "Bearer user").result_int(), 404U);
  const Response picture = Get(kRender, "Bearer user");
  EXPECT_EQ(HeaderOf(picture, "Cache-Control"), "private, no-cache");
  EXPECT_EQ(picture.body().substr(1, 3), "PNG");
  // Text that a header can't carry never reaches one.
  for (const std::string& hostile :
       {std::string("a%0d%0ab"), std::string("%00"), std::string("%c3%a9"), std::string("a%20b"),
        std::string(4000, 'x')}) {
    // 400 where the address itself is none.
    EXPECT_THAT(Get("/v1/datasets?token=" + hostile).result_int(), AnyOf(400U, 401U)) << hostile;
  }
  EXPECT_EQ(Get("/healthz").body(), "ok\n");
}

TEST_F(GatewayTlsTest, ViewsMoveOverTls) {
  for (const std::string token : {"user", "wrong"}) {
    SecureConnection connection(gateway_.address, authority_.ca_file());
    ASSERT_FALSE(connection.error()) << connection.error().message();
    websocket::stream<asio::ssl::stream<tcp::socket>&> socket(connection.stream());
    socket.read_message_max(std::uint64_t{1} << 30);
    socket.handshake("127.0.0.1", "/v1/interact?token=" + token);
    error_code error;
    socket.write(
        asio::buffer(std::string(
            R"({"viewState":{"sequenceNumber":"1","isAtRest":true,"frame":{"dataset":"gyroid",)"
            R"("isovalue":128,"viewport":{"widthPx":96,"heightPx":80}}}})")),
        error);
    std::string all;
    while (!error && all.find("\"isExact\":true") == std::string::npos) {
      beast::flat_buffer buffer;
      socket.read(buffer, error);
      all.append(static_cast<const char*>(buffer.cdata().data()), buffer.size());
    }
    if (token == "user") {
      EXPECT_FALSE(error) << error.message();
      EXPECT_THAT(all, HasSubstr("PNG"));
    } else {
      EXPECT_EQ(error, websocket::error::closed) << error.message();
      EXPECT_EQ(socket.reason().code, websocket::close_code::policy_error);
      EXPECT_THAT(std::string(socket.reason().reason.c_str()), HasSubstr("token"));
    }
  }
}

TEST_F(GatewayTlsTest, PlaintextAndOtherAuthoritiesGetNothing) {
  {
    asio::io_context io;
    tcp::socket socket(io);
    const std::vector<std::string> parts = absl::StrSplit(gateway_.address, ':');
    asio::connect(socket, tcp::resolver(io).resolve(parts[0], parts[1]));
    asio::write(socket, asio::buffer(std::string("GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n")));
    std::string all;
    error_code error;
    asio::read(socket, asio::dynamic_buffer(all), error);
    EXPECT_THAT(all, Not(HasSubstr("HTTP/1.1")));
  }
  const TestAuthority other;
  EXPECT_TRUE(SecureConnection(gateway_.address, other.ca_file()).error());
  EXPECT_TRUE(SecureConnection(gateway_.address, authority_.ca_file(), "view.example").error());
  EXPECT_EQ(Get("/healthz").body(), "ok\n");
}

TEST_F(GatewayTlsTest, HandshakesThatNeverFinishShutNobodyOut) {
  testing::RaiseFileLimit();
  std::vector<testing::RawConnection> silent;
  for (int i = 0; i < 600; ++i) {
    // The second half has the beginning of a ClientHello.
    silent.emplace_back(testing::PortOf(gateway_.address))
        .Send(i < 300 ? "" : std::string("\x16\x03\x01\x02\x00\x01\x00", 7));
  }
  SecureConnection stranger(gateway_.address, authority_.ca_file());
  EXPECT_EQ(stranger.Get("/healthz").result_int(), 200U);
  SecureConnection user(gateway_.address, authority_.ca_file());
  EXPECT_EQ(user.Get("/v1/datasets", "Bearer user").result_int(), 200U);
  const testing::CommandResult probe = testing::RunCommand(
      Flags{ISOSCOPE_TEST_GATEWAY, "--probe", "--listen", gateway_.address} + gateway_flags_, {});
  EXPECT_EQ(probe.exit_code, 0) << probe.err;
}

TEST_F(GatewayTlsTest, ANewCertificateIsShownToNewConnections) {
  SecureConnection before(gateway_.address, authority_.ca_file());
  ASSERT_FALSE(before.error());
  authority_.Issue({.name = "gateway", .alternative_names = "DNS:new.test", .role = "gateway"});
  const base::MonotonicTime limit = base::MonotonicNow() + kPatience;
  bool is_shown = false;
  while (!is_shown && base::MonotonicNow() < limit) {
    is_shown = !SecureConnection(gateway_.address, authority_.ca_file(), "new.test").error();
  }
  EXPECT_TRUE(is_shown);
  EXPECT_EQ(before.Get("/healthz").body(), "ok\n") << "an old connection was cut";
}

TEST_F(GatewayTlsTest, TheProbeAsksForHealth) {
  const Flags own = Flags{ISOSCOPE_TEST_GATEWAY, "--listen", gateway_.address} + gateway_flags_;
  testing::CommandResult result = testing::RunCommand(own + Flags{"--probe"}, {});
  EXPECT_EQ(result.exit_code, 0) << result.out << result.err;
  result = testing::RunCommand(own + Flags{"--probe=" + gateway_.address}, {});
  EXPECT_EQ(result.exit_code, 0) << result.out << result.err;
  result = testing::RunCommand({ISOSCOPE_TEST_GATEWAY, "--probe=" + gateway_.address}, {});
  EXPECT_EQ(result.exit_code, 1) << "plaintext to TLS";
  coordinator_.process->Kill();
  result = testing::RunCommand(own + Flags{"--probe"}, {});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.out, HasSubstr("503"));
}

TEST_F(GatewayTlsTest, AGatewayWithATokenOfItsOwnAsksForThat) {
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(folder_.Sub("token"), "user\n"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      gateway_, testing::StartGateway(coordinator_.address,
                                      gateway_flags_ + Flags{"--token", "own", "--token-file",
                                                             folder_.Sub("token")}));
  EXPECT_EQ(Get("/v1/datasets", "Bearer user").result_int(), 401U) << "the coordinator's token";
  const Response allowed = Get("/v1/datasets", "Bearer own");
  EXPECT_EQ(allowed.result_int(), 200U) << allowed.body();
  EXPECT_THAT(allowed.body(), HasSubstr("gyroid"));
}

TEST_F(GatewayTlsTest, TheVariablesOfTheTokenToSendAndOfTheOneToAskForAreTwo) {
  setenv("ISOSCOPE_TOKEN", "user", 1);
  setenv("ISOSCOPE_GATEWAY_TOKEN", "own", 1);
  absl::StatusOr<ServerProcess> gateway =
      testing::StartGateway(coordinator_.address, gateway_flags_);
  unsetenv("ISOSCOPE_TOKEN");
  unsetenv("ISOSCOPE_GATEWAY_TOKEN");
  ISOSCOPE_ASSERT_OK(gateway);
  gateway_ = *std::move(gateway);
  EXPECT_EQ(Get("/v1/datasets", "Bearer user").result_int(), 401U) << "the coordinator's token";
  const Response allowed = Get("/v1/datasets", "Bearer own");
  EXPECT_EQ(allowed.result_int(), 200U) << allowed.body();
  EXPECT_THAT(allowed.body(), HasSubstr("gyroid"));
}

TEST_F(GatewayTlsTest, PlainHttpBehindAProxyKeepsTlsToTheCoordinator) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      gateway_, testing::StartGateway(coordinator_.address,
                                      gateway_flags_ + Flags{"--user-tokens", "--http"}));
  const testing::CommandResult result = testing::RunCommand(
      Flags{ISOSCOPE_TEST_GATEWAY, "--probe=" + gateway_.address, "--http"} + gateway_flags_, {});
  EXPECT_EQ(result.exit_code, 0) << result.out << result.err;
  EXPECT_THAT(gateway_.process->err(), HasSubstr("page=http://"));
}

}  // namespace
}  // namespace isoscope
