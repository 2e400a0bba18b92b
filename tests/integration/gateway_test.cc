// The gateway as browsers and web back ends meet it: over real sockets, in front of a cluster of
// real processes, and in front of fakes for what a real coordinator does not do on demand.

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/time/clock.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <grpcpp/server_builder.h>
#include <nlohmann/json.hpp>

#include "core/base/coding.h"
#include "core/base/metrics.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/io/file.h"
#include "isoscope/v1/dataset_service.grpc.pb.h"
#include "isoscope/v1/interact_service.grpc.pb.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "rpc/channel.h"
#include "rpc/grpc_time.h"
#include "tests/support/process_cluster.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "web-gateway/gateway_server.h"

namespace isoscope {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
namespace v1 = isoscope::v1;
using asio::ip::tcp;
using boost::system::error_code;
using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::IsOk;
using testing::ProcessCluster;
using testing::ServerProcess;
using ::testing::StartsWith;

constexpr char kRender[] = "/v1/datasets/d/render?isovalue=128&width=96&height=80";
constexpr char kPostedFrame[] = R"({"isovalue":128,"viewport":{"widthPx":96,"heightPx":80}})";

// A blocking connection to "HOST:PORT".
class Connection {
 public:
  explicit Connection(const std::string& address) : socket_(io_) {
    const std::vector<std::string> parts = absl::StrSplit(address, ':');
    tcp::resolver resolver(io_);
    asio::connect(socket_, resolver.resolve(parts[0], parts[1]));
  }

  void Send(const std::string& bytes) {
    error_code ignored;  // the gateway may close while it is told nonsense
    asio::write(socket_, asio::buffer(bytes), ignored);
  }
  // All that comes until the end of the connection.
  std::string ReadAll() {
    std::string all;
    error_code error;
    asio::read(socket_, asio::dynamic_buffer(all), error);
    return all;
  }
  http::response<http::string_body> Ask(const http::request<http::string_body>& request) {
    error_code error;
    http::write(socket_, request, error);
    http::response_parser<http::string_body> parser;
    parser.body_limit(std::uint64_t{1} << 30);
    parser.skip(request.method() == http::verb::head);
    http::read(socket_, buffer_, parser, error);
    EXPECT_FALSE(error) << error.message();
    return parser.release();
  }
  void Close() { socket_.close(); }
  tcp::socket& socket() { return socket_; }

 private:
  asio::io_context io_;
  tcp::socket socket_;
  beast::flat_buffer buffer_;
};

using Headers = std::vector<std::pair<std::string, std::string>>;

http::request<http::string_body> MakeRequest(const std::string& address, http::verb method,
                                             const std::string& target, const Headers& headers,
                                             const std::string& body) {
  http::request<http::string_body> request(method, target, 11);
  request.set(http::field::host, address);
  for (const auto& [name, value] : headers) {
    request.set(name, value);
  }
  request.body() = body;
  request.prepare_payload();
  return request;
}

http::response<http::string_body> Get(const std::string& address, const std::string& target,
                                      const Headers& headers = {}) {
  return Connection(address).Ask(MakeRequest(address, http::verb::get, target, headers, ""));
}

http::response<http::string_body> Post(const std::string& address, const std::string& target,
                                       const std::string& body, const Headers& headers = {}) {
  return Connection(address).Ask(MakeRequest(address, http::verb::post, target, headers, body));
}

std::string HeaderOf(const http::response<http::string_body>& response, const std::string& name) {
  const auto value = response[name];
  return std::string(value.data(), value.size());
}

nlohmann::json Json(const std::string& text) {
  nlohmann::json parsed = nlohmann::json::parse(text, nullptr, /*allow_exceptions=*/false);
  EXPECT_FALSE(parsed.is_discarded()) << text;
  return parsed;
}

// A frame as it comes over the WebSocket.
struct Frame {
  nlohmann::json json;
  std::string image;
  std::string depths;

  [[nodiscard]] std::int64_t number() const {
    std::int64_t value = 0;
    EXPECT_TRUE(absl::SimpleAtoi(json["frameNumber"].get<std::string>(), &value));
    return value;
  }
  [[nodiscard]] bool is_exact() const { return json.value("isExact", false); }
};

// A page's WebSocket.
class Viewer {
 public:
  explicit Viewer(const std::string& address, const std::string& target = "/v1/interact",
                  const std::string& origin = "", const std::string& protocols = "")
      : connection_(address), socket_(connection_.socket()) {
    socket_.set_option(
        websocket::stream_base::decorator([origin, protocols](websocket::request_type& request) {
          if (!origin.empty()) {
            request.set(http::field::origin, origin);
          }
          if (!protocols.empty()) {
            request.set(http::field::sec_websocket_protocol, protocols);
          }
        }));
    socket_.read_message_max(std::uint64_t{1} << 30);
    socket_.handshake(answer_, address, target, error_);
  }

  // The status of the answer to the handshake; 101 if it is a WebSocket now.
  [[nodiscard]] unsigned status() const { return answer_.result_int(); }
  // The protocol that the gateway has chosen.
  [[nodiscard]] std::string protocol() const {
    const auto value = answer_[http::field::sec_websocket_protocol];
    return std::string(value.data(), value.size());
  }
  void Send(const std::string& text) {
    socket_.text(true);
    socket_.write(asio::buffer(text), error_);
  }
  void SendBinary(const std::string& bytes) {
    socket_.binary(true);
    socket_.write(asio::buffer(bytes), error_);
  }
  void SendState(int sequence, const std::string& frame, bool is_at_rest) {
    Send(absl::StrCat(R"({"viewState":{"sequenceNumber":")", sequence, R"(","frame":)", frame,
                      R"(,"isAtRest":)", is_at_rest ? "true" : "false", "}}"));
  }
  void SendShown(std::int64_t number) {
    Send(absl::StrCat(R"({"frameShown":{"frameNumber":")", number, R"("}})"));
  }
  // The next frame; none at the end.
  std::optional<Frame> Read() {
    beast::flat_buffer buffer;
    socket_.read(buffer, error_);
    if (error_) {
      return std::nullopt;
    }
    EXPECT_TRUE(socket_.got_binary());
    const std::string bytes(static_cast<const char*>(buffer.cdata().data()), buffer.size());
    const auto json_bytes = base::LoadLittleEndian<std::uint32_t>(bytes.data());
    Frame frame{.json = Json(bytes.substr(4, json_bytes)), .image = {}, .depths = {}};
    const auto image_bytes = frame.json["image"]["bytes"].get<std::size_t>();
    frame.image = bytes.substr(4 + json_bytes, image_bytes);
    frame.depths = bytes.substr(4 + json_bytes + image_bytes);
    EXPECT_EQ(frame.depths.size(), frame.json["depthBytes"].get<std::size_t>());
    return frame;
  }
  // Reads and acknowledges until the exact frame.
  std::optional<Frame> ReadExact() {
    while (std::optional<Frame> frame = Read()) {
      SendShown(frame->number());
      if (frame->is_exact() || frame->json.contains("error")) {
        return frame;
      }
    }
    return std::nullopt;
  }
  // Reads until the gateway closes. Returns the code and the reason.
  std::pair<int, std::string> ReadClose() {
    while (Read()) {
    }
    return {socket_.reason().code, std::string(socket_.reason().reason.c_str())};
  }
  void Drop() { connection_.Close(); }

 private:
  Connection connection_;
  websocket::stream<tcp::socket&> socket_;
  websocket::response_type answer_;
  error_code error_;
};

class GatewayTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new testing::TempDir();
    ISOSCOPE_ASSERT_OK(testing::MakeDataset(testing::GyroidVolume({43, 37, 29}), folder_->Sub("d"),
                                            /*shard_count=*/2, 8));
    absl::StatusOr<std::unique_ptr<ProcessCluster>> cluster =
        ProcessCluster::Start(folder_->Sub("d"), 2);
    ISOSCOPE_ASSERT_OK(cluster);
    cluster_ = cluster->release();
    absl::StatusOr<ServerProcess> gateway =
        testing::StartGateway(cluster_->address(), {"--no-token"});
    ISOSCOPE_ASSERT_OK(gateway);
    gateway_ = new ServerProcess(*std::move(gateway));
  }
  static void TearDownTestSuite() {
    delete gateway_;
    delete cluster_;
    delete folder_;
  }

  [[nodiscard]] static const std::string& address() { return gateway_->address; }
  // The picture that every client must get.
  static std::string ExpectedPng() {
    const absl::StatusOr<v1::RenderIsosurfaceResponse> response =
        testing::Render(cluster_->address(), testing::SmallRequest());
    EXPECT_THAT(response, IsOk());
    return response.ok() ? response->png() : "";
  }

  static testing::TempDir* folder_;
  static ProcessCluster* cluster_;
  static ServerProcess* gateway_;
};

testing::TempDir* GatewayTest::folder_ = nullptr;
ProcessCluster* GatewayTest::cluster_ = nullptr;
ServerProcess* GatewayTest::gateway_ = nullptr;

TEST_F(GatewayTest, PicturesAreTheBytesOfRenderIsosurface) {
  const std::string expected = ExpectedPng();
  const auto by_name = Get(address(), kRender);
  EXPECT_EQ(by_name.result_int(), 200U);
  EXPECT_EQ(HeaderOf(by_name, "Content-Type"), "image/png");
  EXPECT_EQ(HeaderOf(by_name, "X-Isoscope-Extent"), "96x80");
  EXPECT_TRUE(by_name.body() == expected);
  const auto posted = Post(address(), "/v1/datasets/d/render", kPostedFrame);
  EXPECT_EQ(posted.result_int(), 200U) << posted.body();
  EXPECT_TRUE(posted.body() == expected);
  EXPECT_EQ(HeaderOf(posted, "Cache-Control"), "no-store");

  const auto jpeg = Get(address(), absl::StrCat(kRender, "&format=jpeg"));
  EXPECT_EQ(HeaderOf(jpeg, "Content-Type"), "image/jpeg");
  EXPECT_THAT(jpeg.body(), StartsWith("\xff\xd8"));
  const auto depth = Get(address(), absl::StrCat(kRender, "&format=depth"));
  EXPECT_EQ(HeaderOf(depth, "Content-Type"), "application/octet-stream");
  v1::RenderIsosurfaceRequest request = testing::SmallRequest();
  request.mutable_output()->set_depth(true);
  const auto response = testing::Render(cluster_->address(), request);
  ISOSCOPE_ASSERT_OK(response);
  EXPECT_TRUE(depth.body() == response->depth());
}

TEST_F(GatewayTest, APictureThatTheClientHasIsNotMadeAgain) {
  const auto first = Get(address(), kRender);
  const std::string etag = HeaderOf(first, "ETag");
  EXPECT_THAT(etag, StartsWith("\""));
  EXPECT_EQ(HeaderOf(first, "Cache-Control"), "public, no-cache");
  const auto second = Get(address(), kRender, {{"If-None-Match", etag}});
  EXPECT_EQ(second.result_int(), 304U);
  EXPECT_EQ(second.body(), "");
  EXPECT_EQ(HeaderOf(second, "ETag"), etag);
  const auto other = Get(address(), absl::StrCat(kRender, "&azimuth=1"), {{"If-None-Match", etag}});
  EXPECT_EQ(other.result_int(), 200U);

  const std::string id = Json(Get(address(), "/v1/datasets/d").body())["datasetId"];
  const auto by_id =
      Get(address(), absl::StrCat("/v1/datasets/", id, "/render?isovalue=128&width=96&height=80"));
  EXPECT_THAT(HeaderOf(by_id, "Cache-Control"), HasSubstr("immutable"));
  EXPECT_TRUE(by_id.body() == first.body());
  EXPECT_EQ(HeaderOf(Get(address(), absl::StrCat(kRender, "&culling=mask")), "Cache-Control"),
            "no-store");
}

TEST_F(GatewayTest, FactsAreJson) {
  EXPECT_EQ(Get(address(), "/healthz").body(), "ok\n");
  EXPECT_GT(Json(Get(address(), "/v1/capabilities").body())["maxViewportPx"], 0);
  EXPECT_EQ(Json(Get(address(), "/v1/status").body())["agents"].size(), 2U);
  EXPECT_EQ(Json(Get(address(), "/v1/datasets").body())["datasets"][0]["name"], "d");
  EXPECT_EQ(Json(Get(address(), "/v1/datasets/d").body())["shardCount"], 2);
  EXPECT_FALSE(Json(Get(address(), "/v1/datasets/d/histogram?bins=16").body())["bins"].empty());
  const auto page = Get(address(), "/");
  EXPECT_THAT(HeaderOf(page, "Content-Security-Policy"), HasSubstr("default-src 'none'"));
  EXPECT_EQ(HeaderOf(page, "X-Content-Type-Options"), "nosniff");
}

TEST_F(GatewayTest, ABrowserKeepsTheModuleOfThePage) {
  const std::string page = Get(address(), "/").body();
  const std::size_t start = page.find("bundle.js?v=");
  ASSERT_NE(start, std::string::npos);
  const std::string target = absl::StrCat("/", page.substr(start, page.find('"', start) - start));
  const auto module = Get(address(), target);
  EXPECT_EQ(module.result_int(), 200U);
  EXPECT_THAT(HeaderOf(module, "Cache-Control"), HasSubstr("immutable"));
  EXPECT_THAT(HeaderOf(module, "Content-Security-Policy"), HasSubstr("default-src 'none'"));
  EXPECT_EQ(Get(address(), target, {{"If-None-Match", HeaderOf(module, "ETag")}}).result_int(),
            304U);
}

TEST_F(GatewayTest, PicksAndMeshesAreThoseOfTheService) {
  const auto pick =
      Post(address(), "/v1/datasets/d/pick",
           absl::StrCat(R"({"frame":)", kPostedFrame, R"(,"pixels":[{"x":48,"y":40}]})"));
  EXPECT_EQ(pick.result_int(), 200U) << pick.body();
  EXPECT_EQ(Json(pick.body())["points"].size(), 1U);
  const auto mesh = Get(address(), "/v1/datasets/d/mesh.glb?isovalue=128");
  EXPECT_EQ(mesh.result_int(), 200U) << mesh.body();
  EXPECT_EQ(HeaderOf(mesh, "Content-Type"), "model/gltf-binary");
  EXPECT_THAT(mesh.body(), StartsWith("glTF"));
  ASSERT_GE(mesh.body().size(), 12U);
  EXPECT_EQ(base::LoadLittleEndian<std::uint32_t>(mesh.body().data() + 8), mesh.body().size());
}

TEST_F(GatewayTest, ErrorsSayWhatAndWhatIsAllowed) {
  const struct {
    std::string target;
    unsigned status;
    std::vector<std::string> said;
  } cases[] = {
      {"/v1/datasets/d/render", 400, {"INVALID_ARGUMENT", "isovalue"}},
      {"/v1/datasets/d/render?isovalue=x", 400, {"isovalue", "'x'", "finite number"}},
      {"/v1/datasets/d/render?isovalue=1&width=0", 400, {"width", "'0'", "1 to 65536"}},
      {"/v1/datasets/d/render?isovalue=1&width=65536", 400, {"65536"}},
      {"/v1/datasets/d/render?isovalue=1&camera=/etc/passwd", 400, {"no parameter 'camera'"}},
      {"/v1/datasets/d/histogram?bins=5000", 400, {"bins", "'5000'", "4096"}},
      {"/v1/datasets/d/histogram?bin=5", 400, {"'bin'"}},
      {"/v1/datasets/e/render?isovalue=1", 404, {"NOT_FOUND", "'e'", "there are: d"}},
      {"/v1/datasets/d/rendr", 404, {"mesh.glb"}},
      {"/v1/datasets/d/pick", 405, {"POST"}},
      {"/v2", 404, {"no page"}},
      {"/absent.js", 404, {"absent.js"}},
      {"/v1/interact", 426, {"WebSocket"}},
      {"/%zz", 400, {"%"}},
  };
  for (const auto& c : cases) {
    const auto response = Get(address(), c.target);
    EXPECT_EQ(response.result_int(), c.status) << c.target << ": " << response.body();
    const nlohmann::json json = Json(response.body());
    EXPECT_TRUE(json.contains("code") && json.contains("message")) << response.body();
    for (const std::string& said : c.said) {
      EXPECT_THAT(response.body(), HasSubstr(said)) << c.target;
    }
    EXPECT_EQ(HeaderOf(response, "Cache-Control"), "no-store") << c.target;
  }
  for (const std::string& body :
       {std::string("x"), std::string(R"({"isovaleu":1})"), std::string(R"({"dataset":"e"})"),
        std::string(
            R"({"isovalue":1,"viewport":{"widthPx":8,"heightPx":8},"output":{"depth":true}})")}) {
    EXPECT_EQ(Post(address(), "/v1/datasets/d/render", body).result_int(), 400U) << body;
  }
}

TEST_F(GatewayTest, HeadHasTheHeaderAlone) {
  Connection connection(address());
  const auto response = connection.Ask(MakeRequest(address(), http::verb::head, kRender, {}, ""));
  EXPECT_EQ(response.result_int(), 200U);
  EXPECT_EQ(response.body(), "");
  EXPECT_EQ(HeaderOf(response, "Content-Length"), absl::StrCat(ExpectedPng().size()));
  // The connection is good for another request.
  EXPECT_EQ(connection.Ask(MakeRequest(address(), http::verb::get, "/healthz", {}, "")).body(),
            "ok\n");
}

TEST_F(GatewayTest, HeadOfAMeshIsAHeaderAndTheNextAnswerIsWhole) {
  Connection connection(address());
  connection.Send(
      "HEAD /v1/datasets/d/mesh.glb?isovalue=128 HTTP/1.1\r\nHost: localhost\r\n\r\n"
      "GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
  const std::string all = connection.ReadAll();
  EXPECT_THAT(all, AllOf(StartsWith("HTTP/1.1 200"), HasSubstr("model/gltf-binary"),
                         ::testing::EndsWith("\r\n\r\nok\n")));
  EXPECT_THAT(all.substr(all.find("\r\n\r\n") + 4), StartsWith("HTTP/1.1 200"));
  EXPECT_LT(all.size(), 2000U);
}

TEST_F(GatewayTest, PicturesInPagesOfOtherOriginsAreRefused) {
  const std::string mesh = "/v1/datasets/d/mesh.glb?isovalue=128";
  for (const std::string site : {"cross-site", "same-site"}) {
    for (const std::string& target : {std::string(kRender), mesh, std::string("/v1/datasets")}) {
      const auto refused = Get(address(), target, {{"Sec-Fetch-Site", site}});
      EXPECT_EQ(refused.result_int(), 403U) << site << target;
      EXPECT_THAT(refused.body(), HasSubstr("--allow-origin"));
      EXPECT_EQ(HeaderOf(refused, "Cross-Origin-Resource-Policy"), "same-origin");
    }
    // A link to the page is followed.
    const auto page =
        Get(address(), "/", {{"Sec-Fetch-Site", site}, {"Sec-Fetch-Mode", "navigate"}});
    EXPECT_EQ(page.result_int(), 200U) << site;
    EXPECT_EQ(HeaderOf(page, "Cross-Origin-Resource-Policy"), "same-origin");
  }
  for (const std::string site : {"same-origin", "none"}) {
    const auto picture = Get(address(), kRender, {{"Sec-Fetch-Site", site}});
    EXPECT_EQ(picture.result_int(), 200U) << site;
    EXPECT_EQ(HeaderOf(picture, "Cross-Origin-Resource-Policy"), "same-origin");
  }
}

TEST_F(GatewayTest, HostileRequestsAreRefusedAndHarmNobody) {
  const struct {
    std::string name;
    std::string bytes;
    std::string answer;
  } cases[] = {
      {"garbage", "\x16\x03\x01 not http\r\n\r\n", "HTTP/1.1 400"},
      {"long header", absl::StrCat("GET / HTTP/1.1\r\nX: ", std::string(20000, 'a'), "\r\n\r\n"),
       "HTTP/1.1 431"},
      {"long target", absl::StrCat("GET /", std::string(20000, 'a'), " HTTP/1.1\r\n\r\n"),
       "HTTP/1.1 431"},
      {"long body",
       absl::StrCat("POST /v1/datasets/d/pick HTTP/1.1\r\nHost: localhost\r\n"
                    "Content-Length: 2000000\r\n\r\n",
                    std::string(2000, 'a')),
       "HTTP/1.1 413"},
      {"no host", "GET /healthz HTTP/1.1\r\nConnection: close\r\n\r\n", "HTTP/1.1 400"},
      {"foreign host", "GET /v1/datasets HTTP/1.1\r\nHost: evil.org\r\nConnection: close\r\n\r\n",
       "HTTP/1.1 403"},
      {"other method",
       "DELETE /v1/datasets HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n",
       "HTTP/1.1 405"},
      {"proxy", "CONNECT evil.org:443 HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n",
       "HTTP/1.1 400"},
  };
  for (const auto& c : cases) {
    Connection connection(address());
    connection.Send(c.bytes);
    EXPECT_THAT(connection.ReadAll(), StartsWith(c.answer)) << c.name;
  }
  EXPECT_EQ(Get(address(), "/healthz").result_int(), 200U);
}

TEST_F(GatewayTest, AForeignPageGetsNothing) {
  const Headers evil = {{"Origin", "http://evil.org"}};
  EXPECT_EQ(Get(address(), "/v1/datasets", evil).result_int(), 403U);
  EXPECT_EQ(Post(address(), "/v1/datasets/d/render", kPostedFrame, evil).result_int(), 403U);
  EXPECT_EQ(Viewer(address(), "/v1/interact", "http://evil.org").status(), 403U);
  EXPECT_EQ(Viewer(address(), "/v1/interact", "null").status(), 403U);
  EXPECT_EQ(Viewer(address(), "/v1/interact", absl::StrCat("http://", address())).status(), 101U);
  EXPECT_EQ(Viewer(address(), "/v1/other").status(), 404U);
}

TEST_F(GatewayTest, AllowedOriginsMayAskAndSeeTheAnswer) {
  absl::StatusOr<ServerProcess> gateway = testing::StartGateway(
      cluster_->address(), {"--no-token", "--allow-origin", "https://hub.org"});
  ISOSCOPE_ASSERT_OK(gateway);
  const Headers hub = {{"Origin", "https://hub.org"}};
  const auto response = Get(gateway->address, "/v1/datasets", hub);
  EXPECT_EQ(response.result_int(), 200U);
  EXPECT_EQ(HeaderOf(response, "Access-Control-Allow-Origin"), "https://hub.org");
  EXPECT_EQ(Viewer(gateway->address, "/v1/interact", "https://hub.org").status(), 101U);
  const auto preflight = Connection(gateway->address)
                             .Ask(MakeRequest(gateway->address, http::verb::options,
                                              "/v1/datasets/d/render", hub, ""));
  EXPECT_EQ(preflight.result_int(), 204U);
  EXPECT_THAT(HeaderOf(preflight, "Access-Control-Allow-Methods"), HasSubstr("POST"));
  EXPECT_THAT(HeaderOf(preflight, "Access-Control-Allow-Headers"), HasSubstr("Authorization"));
  // An <img> has no Origin.
  const auto image = Get(gateway->address, kRender,
                         {{"Sec-Fetch-Site", "cross-site"}, {"Referer", "https://hub.org/a/b"}});
  EXPECT_EQ(image.result_int(), 200U);
  EXPECT_EQ(HeaderOf(image, "Cross-Origin-Resource-Policy"), "cross-origin");
  for (const std::string referer : {"", "https://hub.org.evil.org/", "http://hub.org/"}) {
    EXPECT_EQ(
        Get(gateway->address, kRender, {{"Sec-Fetch-Site", "cross-site"}, {"Referer", referer}})
            .result_int(),
        403U)
        << referer;
  }
}

// isoscope-gateway with variables of its own.
ServerProcess StartGatewayWith(const std::string& coordinator,
                               const std::vector<std::string>& environment,
                               const std::vector<std::string>& flags) {
  std::vector<std::string> argv = {ISOSCOPE_TEST_GATEWAY, "--listen", "127.0.0.1:0", "--server",
                                   coordinator};
  argv.insert(argv.end(), flags.begin(), flags.end());
  absl::StatusOr<std::unique_ptr<testing::Process>> process =
      testing::Process::Start(argv, {.environment = environment});
  EXPECT_THAT(process, IsOk());
  const absl::StatusOr<std::string> line = (*process)->WaitForErrLine("gateway_started");
  EXPECT_THAT(line, IsOk());
  const std::string text = line.value_or("");
  const std::string address = text.substr(text.find("address=") + 8);
  return {.process = *std::move(process), .address = address.substr(0, address.find(' '))};
}

// Returns the text after "?token=" up to the next parameter.
std::string TokenIn(const std::string& text) {
  const std::size_t begin = text.find("?token=");
  const std::string token = begin == std::string::npos ? "" : text.substr(begin + 7);
  return token.substr(0, token.find_first_of("& \"\n"));
}

TEST_F(GatewayTest, OnLoopbackTooTheGatewayAsksForATokenThatOnlyItsLogHas) {
  const ServerProcess gateway = StartGatewayWith(cluster_->address(), {}, {});
  const std::string token = TokenIn(gateway.process->err());
  EXPECT_EQ(token.size(), 32U) << gateway.process->err();
  EXPECT_EQ(Get(gateway.address, "/").result_int(), 200U);
  EXPECT_EQ(Get(gateway.address, "/healthz").result_int(), 200U);
  EXPECT_EQ(Get(gateway.address, kRender).result_int(), 401U);
  EXPECT_EQ(Viewer(gateway.address).status(), 401U);
  EXPECT_EQ(Get(gateway.address, kRender, {{"Authorization", "Bearer " + token}}).result_int(),
            200U);
  const testing::CommandResult probe =
      testing::RunCommand({ISOSCOPE_TEST_GATEWAY, "--probe=" + gateway.address}, {});
  EXPECT_EQ(probe.exit_code, 0) << probe.out << probe.err;
}

TEST_F(GatewayTest, TheTokenToAskForComesByFileOrVariableAndTheOldNamesWorkWithAWarning) {
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(folder_->Sub("token"), "secret\n"));
  const struct {
    std::vector<std::string> environment;
    std::vector<std::string> flags;
    bool has_warning;
  } cases[] = {
      {{"ISOSCOPE_GATEWAY_TOKEN=secret"}, {}, false},
      {{}, {"--gateway-token-file", folder_->Sub("token")}, false},
      {{"ISOSCOPE_GATEWAY_TOKEN_FILE=" + folder_->Sub("token")}, {}, false},
      // The token to send does not count.
      {{"ISOSCOPE_GATEWAY_TOKEN=secret", "ISOSCOPE_TOKEN=other"}, {}, false},
      {{"ISOSCOPE_TOKEN=secret"}, {}, true},
      {{}, {"--token", "secret"}, true},
  };
  for (const auto& c : cases) {
    const ServerProcess gateway = StartGatewayWith(cluster_->address(), c.environment, c.flags);
    const std::string log = gateway.process->err();
    EXPECT_EQ(Get(gateway.address, kRender).result_int(), 401U) << log;
    EXPECT_EQ(Get(gateway.address, kRender, {{"Authorization", "Bearer other"}}).result_int(), 401U)
        << log;
    EXPECT_EQ(Get(gateway.address, kRender, {{"Authorization", "Bearer secret"}}).result_int(),
              200U)
        << log;
    EXPECT_EQ(absl::StrContains(log, "warning old_option"), c.has_warning) << log;
    EXPECT_FALSE(absl::StrContains(log, "secret")) << log;
  }
}

TEST_F(GatewayTest, ATokenThatIsGivenAndOneThatIsNotAskedForAreAContradiction) {
  for (const std::string flag : {"--no-token", "--user-tokens"}) {
    const testing::CommandResult result =
        testing::RunCommand({ISOSCOPE_TEST_GATEWAY, "--listen", "127.0.0.1:0", flag},
                            {.environment = {"ISOSCOPE_GATEWAY_TOKEN=secret"}});
    EXPECT_EQ(result.exit_code, 2) << flag;
    EXPECT_THAT(result.err, AllOf(HasSubstr("ISOSCOPE_GATEWAY_TOKEN"), HasSubstr(flag)));
  }
}

TEST_F(GatewayTest, AViewerShowsItsTokenWithoutAnAddressThatHasIt) {
  const ServerProcess gateway =
      StartGatewayWith(cluster_->address(), {"ISOSCOPE_GATEWAY_TOKEN=a+b/c="}, {});
  const Viewer allowed(gateway.address, "/v1/interact", "", "isoscope, isoscope.bearer.YStiL2M9");
  EXPECT_EQ(allowed.status(), 101U);
  EXPECT_EQ(allowed.protocol(), "isoscope");
  EXPECT_EQ(
      Viewer(gateway.address, "/v1/interact", "", "isoscope, isoscope.bearer.YStiL2M8").status(),
      401U);
  EXPECT_EQ(Viewer(gateway.address, "/v1/interact", "", "isoscope").status(), 401U);
  EXPECT_EQ(Viewer(gateway.address, "/v1/interact?token=a%2Bb%2Fc%3D").status(), 101U);
}

TEST_F(GatewayTest, ATokenIsAskedForInEveryRequestForData) {
  absl::StatusOr<ServerProcess> gateway =
      testing::StartGateway(cluster_->address(), {"--token", "secret"});
  ISOSCOPE_ASSERT_OK(gateway);
  const std::string& guarded = gateway->address;
  EXPECT_EQ(Get(guarded, "/").result_int(), 200U);
  EXPECT_EQ(Get(guarded, "/healthz").result_int(), 200U);
  EXPECT_EQ(Get(guarded, "/v1/datasets").result_int(), 401U);
  EXPECT_EQ(Get(guarded, "/v1/datasets?token=Secret").result_int(), 401U);
  EXPECT_EQ(Get(guarded, "/v1/datasets?token=secret").result_int(), 200U);
  EXPECT_EQ(Get(guarded, "/v1/datasets", {{"Authorization", "Bearer secret"}}).result_int(), 200U);
  EXPECT_EQ(HeaderOf(Get(guarded, absl::StrCat(kRender, "&token=secret")), "Cache-Control"),
            "private, no-cache");
  EXPECT_EQ(Viewer(guarded).status(), 401U);
  EXPECT_EQ(Viewer(guarded, "/v1/interact?token=secret").status(), 101U);
  gateway->process->Kill();
  EXPECT_EQ(gateway->process->err().find("secret"), std::string::npos);
}

TEST_F(GatewayTest, AViewEndsInTheBytesOfRenderIsosurface) {
  const std::string expected = ExpectedPng();
  Viewer viewer(address());
  ASSERT_EQ(viewer.status(), 101U);
  viewer.SendState(1, kPostedFrame, /*is_at_rest=*/false);
  std::optional<Frame> frame = viewer.ReadExact();
  ASSERT_TRUE(frame.has_value());
  ASSERT_FALSE(frame->json.contains("error")) << frame->json.dump();
  EXPECT_TRUE(frame->image == expected);
  EXPECT_EQ(frame->json["image"]["type"], "image/png");
  EXPECT_EQ(frame->json["sequenceNumber"], "1");
  viewer.SendState(2, kPostedFrame, /*is_at_rest=*/true);
  frame = viewer.ReadExact();
  ASSERT_TRUE(frame.has_value());
  EXPECT_TRUE(frame->image == expected);
}

TEST_F(GatewayTest, MovingFramesAreJpegWithDepths) {
  Viewer viewer(address());
  bool has_moving = false;
  for (int sequence = 1; sequence < 1000 && !has_moving; ++sequence) {
    viewer.SendState(sequence, kPostedFrame, /*is_at_rest=*/false);
    const std::optional<Frame> frame = viewer.Read();
    ASSERT_TRUE(frame.has_value());
    viewer.SendShown(frame->number());
    if (!frame->is_exact()) {
      has_moving = true;
      EXPECT_EQ(frame->json["image"]["type"], "image/jpeg");
      EXPECT_THAT(frame->image, StartsWith("\xff\xd8"));
      const int width = frame->json["depthGrid"]["width"];
      const int height = frame->json["depthGrid"]["height"];
      EXPECT_EQ(frame->depths.size(), static_cast<std::size_t>(2 * width * height));
    }
  }
  EXPECT_TRUE(has_moving);
}

TEST_F(GatewayTest, TwoViewersAndAPictureAtATime) {
  const std::string expected = ExpectedPng();
  std::vector<std::thread> clients;
  std::vector<int> right(3, 0);
  for (std::size_t i = 0; i < 2; ++i) {
    clients.emplace_back([&, i] {
      Viewer viewer(address());
      for (int sequence = 1; sequence <= 10; ++sequence) {
        viewer.SendState(sequence, kPostedFrame, /*is_at_rest=*/true);
        const std::optional<Frame> frame = viewer.ReadExact();
        right[i] += static_cast<int>(frame.has_value() && frame->image == expected);
      }
    });
  }
  clients.emplace_back([&] {
    for (int i = 0; i < 10; ++i) {
      right[2] += static_cast<int>(Get(address(), kRender).body() == expected);
    }
  });
  for (std::thread& client : clients) {
    client.join();
  }
  EXPECT_EQ(right, std::vector<int>({10, 10, 10}));
}

TEST_F(GatewayTest, WrongMessagesCloseTheSocketWithAReason) {
  const struct {
    std::string text;
    std::string reason;
  } cases[] = {
      {"x", "InteractRequest"},
      {"{}", "viewState"},
      {R"({"viewState":{"sequenceNumer":"1"}})", "sequenceNumer"},
      {R"({"viewState":{"sequenceNumber":"-5"}})", "sequence_number"},
  };
  for (const auto& c : cases) {
    Viewer viewer(address());
    viewer.Send(c.text);
    const auto [code, reason] = viewer.ReadClose();
    EXPECT_EQ(code, 1008) << c.text;
    EXPECT_THAT(reason, HasSubstr(c.reason)) << c.text;
  }
  Viewer binary(address());
  binary.SendBinary("x");
  EXPECT_EQ(binary.ReadClose().first, 1008);
  Viewer too_long(address());
  too_long.Send(std::string(300 * 1024, ' '));
  EXPECT_NE(too_long.ReadClose().first, 1000);
  // A frame that fails is no wrong message: the stream goes on.
  Viewer viewer(address());
  viewer.SendState(1, R"({"dataset":"absent","isovalue":1,"viewport":{"widthPx":8,"heightPx":8}})",
                   true);
  const std::optional<Frame> failed = viewer.ReadExact();
  ASSERT_TRUE(failed.has_value());
  EXPECT_EQ(failed->json["error"]["code"], 5);
  viewer.SendState(2, kPostedFrame, true);
  const std::optional<Frame> frame = viewer.ReadExact();
  ASSERT_TRUE(frame.has_value());
  EXPECT_TRUE(frame->is_exact());
}

TEST_F(GatewayTest, ALostCoordinatorIsSaidAndFoundAgain) {
  const std::vector<std::string> agents = {cluster_->agent_address(0), cluster_->agent_address(1)};
  absl::StatusOr<ServerProcess> coordinator = testing::StartCoordinator(agents);
  ISOSCOPE_ASSERT_OK(coordinator);
  absl::StatusOr<ServerProcess> gateway =
      testing::StartGateway(coordinator->address, {"--no-token"});
  ISOSCOPE_ASSERT_OK(gateway);
  Viewer viewer(gateway->address);
  viewer.SendState(1, kPostedFrame, true);
  ASSERT_TRUE(viewer.ReadExact().has_value());

  coordinator->process->Kill();
  const auto [code, reason] = viewer.ReadClose();
  EXPECT_EQ(code, 1011);
  EXPECT_NE(reason, "");
  const auto health = Get(gateway->address, "/healthz");
  EXPECT_EQ(health.result_int(), 503U);
  EXPECT_THAT(health.body(), HasSubstr(coordinator->address));
  EXPECT_EQ(Json(Get(gateway->address, kRender).body())["code"], "UNAVAILABLE");
  EXPECT_EQ(Viewer(gateway->address).ReadClose().first, 1011);

  const std::string address = coordinator->address;
  coordinator = testing::StartCoordinator(agents, {"--listen", address});
  ISOSCOPE_ASSERT_OK(coordinator);
  const base::MonotonicTime deadline = base::MonotonicNow() + testing::kPatience;
  while (Get(gateway->address, "/healthz").result_int() != 200U &&
         base::MonotonicNow() < deadline) {
    absl::SleepFor(absl::Milliseconds(20));
  }
  EXPECT_TRUE(Get(gateway->address, kRender).body() == ExpectedPng());
}

// Symptom: 404 "there is no dataset" once the coordinator had noticed that the agents are lost.
TEST_F(GatewayTest, DatasetsWhoseAgentsAreLostAreNotUnknown) {
  absl::StatusOr<std::unique_ptr<ProcessCluster>> cluster =
      ProcessCluster::Start(folder_->Sub("d"), 2);
  ISOSCOPE_ASSERT_OK(cluster);
  absl::StatusOr<ServerProcess> gateway =
      testing::StartGateway((*cluster)->address(), {"--no-token"});
  ISOSCOPE_ASSERT_OK(gateway);
  EXPECT_EQ(Get(gateway->address, kRender).result_int(), 200U);
  (*cluster)->agent(0).Kill();
  (*cluster)->agent(1).Kill();
  for (int i = 0; i < 5; ++i) {
    for (const char* target : {kRender, "/v1/datasets/d/histogram"}) {
      const auto answer = Get(gateway->address, target);
      EXPECT_GE(answer.result_int(), 400U) << target;
      EXPECT_NE(answer.result_int(), 404U) << target << ": " << answer.body();
    }
  }
  EXPECT_EQ(Get(gateway->address, "/v1/datasets/e/histogram").result_int(), 404U);
}

TEST_F(GatewayTest, ShutdownClosesViewersAndEndsWithZero) {
  for (const int signal : {SIGTERM, SIGINT}) {
    absl::StatusOr<ServerProcess> gateway =
        testing::StartGateway(cluster_->address(), {"--no-token"});
    ISOSCOPE_ASSERT_OK(gateway);
    Viewer viewer(gateway->address);
    viewer.SendState(1, kPostedFrame, true);
    ASSERT_TRUE(viewer.ReadExact().has_value());
    Connection idle(gateway->address);
    gateway->process->Signal(signal);
    EXPECT_EQ(viewer.ReadClose().first, 1001);
    EXPECT_EQ(idle.ReadAll(), "");
    const absl::StatusOr<int> exit_code = gateway->process->Wait(testing::kPatience);
    ISOSCOPE_ASSERT_OK(exit_code);
    EXPECT_EQ(*exit_code, 0) << gateway->process->err();
  }
}

TEST_F(GatewayTest, ViewStartsEverythingAndPrintsTheAddressAlone) {
  const testing::ProcessOptions options{.environment = {"XDG_CACHE_HOME=" + folder_->Sub("cache")}};
  absl::StatusOr<std::unique_ptr<testing::Process>> view =
      testing::StartIsoscope({"view", folder_->Sub("d"), "--no-open", "--renderer", "cpu",
                              "--threads", "1", "--listen", "127.0.0.1:0", "--isovalue", "128"},
                             options);
  ISOSCOPE_ASSERT_OK(view);
  const absl::StatusOr<std::string> line = (*view)->WaitForOutLine("http://");
  ISOSCOPE_ASSERT_OK(line);
  EXPECT_THAT(*line, HasSubstr("&dataset=d&isovalue=128"));
  const std::string page = line->substr(std::string("http://").size());
  const std::string host = page.substr(0, page.find('/'));
  const std::string token = TokenIn(*line);
  EXPECT_EQ(token.size(), 32U) << *line;
  EXPECT_EQ(Get(host, "/").result_int(), 200U);
  // Other users of this machine get nothing.
  EXPECT_EQ(Get(host, kRender).result_int(), 401U);
  EXPECT_EQ(Get(host, "/v1/capabilities").result_int(), 401U);
  EXPECT_EQ(Viewer(host, "/v1/interact", "http://" + host).status(), 401U);
  const Headers bearer = {{"Authorization", "Bearer " + token}};
  EXPECT_TRUE(Get(host, kRender, bearer).body() == ExpectedPng());
  EXPECT_THAT(Get(host, "/v1/capabilities", bearer).body(),
              HasSubstr(absl::StrCat("\"gatewayAddress\":\"http://", host, "/\"")));
  Viewer viewer(host, "/v1/interact?token=" + token, "http://" + host);
  viewer.SendState(1, kPostedFrame, true);
  const std::optional<Frame> frame = viewer.ReadExact();
  ASSERT_TRUE(frame.has_value());
  EXPECT_TRUE(frame->image == ExpectedPng());
  (*view)->Signal(SIGINT);
  const absl::StatusOr<int> exit_code = (*view)->Wait(testing::kPatience);
  ISOSCOPE_ASSERT_OK(exit_code);
  EXPECT_EQ(*exit_code, 0) << (*view)->err();
  EXPECT_EQ((*view)->out(), *line + "\n");
}

TEST_F(GatewayTest, ViewServesSeveralInputsAndBeginsWithTheFirst) {
  const testing::ProcessOptions options{.environment = {"XDG_CACHE_HOME=" + folder_->Sub("cache")}};
  const std::string volume = folder_->Sub("other.nrrd");
  const auto made = testing::RunIsoscope({"generate", "shells", "--dims", "9,9,9", "-o", volume});
  ASSERT_EQ(made.exit_code, 0) << made.err;
  std::vector<std::string> arguments = {
      "view", folder_->Sub("d"), volume,        "--no-open",  "--renderer", "cpu", "--threads",
      "1",    "--listen",        "127.0.0.1:0", "--isovalue", "128"};
  absl::StatusOr<std::unique_ptr<testing::Process>> view =
      testing::StartIsoscope(arguments, options);
  ISOSCOPE_ASSERT_OK(view);
  const absl::StatusOr<std::string> line = (*view)->WaitForOutLine("http://");
  ISOSCOPE_ASSERT_OK(line);
  EXPECT_THAT(*line, HasSubstr("&dataset=d&isovalue=128"));
  const std::string page = line->substr(std::string("http://").size());
  const std::string host = page.substr(0, page.find('/'));
  const Headers bearer = {{"Authorization", "Bearer " + TokenIn(*line)}};
  EXPECT_THAT(Get(host, "/v1/datasets", bearer).body(),
              AllOf(HasSubstr("\"name\":\"d\""), HasSubstr("\"name\":\"other\"")));
  EXPECT_EQ(
      Get(host, "/v1/datasets/other/render?isovalue=0.5&width=16&height=16", bearer).result_int(),
      200U);
  (*view)->Signal(SIGINT);
  ISOSCOPE_EXPECT_OK((*view)->Wait(testing::kPatience));

  // Two of one name could not be told apart.
  arguments[2] = folder_->Sub("d");
  const auto twice = testing::RunIsoscope(arguments, options);
  EXPECT_EQ(twice.exit_code, 2);
  EXPECT_THAT(twice.err, HasSubstr("are both the dataset \"d\""));
  // An error names the input that has it.
  arguments[2] = folder_->Sub("none.nrrd");
  EXPECT_THAT(testing::RunIsoscope(arguments, options).err, HasSubstr("none.nrrd"));
}

TEST_F(GatewayTest, ViewAsksForTheTokenThatItWasGiven) {
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(folder_->Sub("view_token"), "of-a-file"));
  const struct {
    std::vector<std::string> environment;
    std::vector<std::string> flags;
    std::string token;
  } cases[] = {
      {{"ISOSCOPE_GATEWAY_TOKEN=of-a-variable"}, {}, "of-a-variable"},
      {{}, {"--gateway-token-file", folder_->Sub("view_token")}, "of-a-file"},
  };
  for (const auto& c : cases) {
    std::vector<std::string> arguments = {"view",     "--server",    cluster_->address(),
                                          "--listen", "127.0.0.1:0", "--no-open"};
    arguments.insert(arguments.end(), c.flags.begin(), c.flags.end());
    absl::StatusOr<std::unique_ptr<testing::Process>> view =
        testing::StartIsoscope(arguments, {.environment = c.environment});
    ISOSCOPE_ASSERT_OK(view);
    const absl::StatusOr<std::string> line = (*view)->WaitForOutLine("http://");
    ISOSCOPE_ASSERT_OK(line);
    EXPECT_EQ(TokenIn(*line), c.token) << *line;
    const std::string page = line->substr(std::string("http://").size());
    const std::string host = page.substr(0, page.find('/'));
    EXPECT_EQ(Get(host, kRender).result_int(), 401U);
    EXPECT_EQ(Get(host, kRender, {{"Authorization", "Bearer " + c.token}}).result_int(), 200U);
  }
}

TEST_F(GatewayTest, OffTheLoopbackAddressTheAddressHasAToken) {
  absl::StatusOr<std::unique_ptr<testing::Process>> view = testing::StartIsoscope(
      {"view", "--server", cluster_->address(), "--listen", "0.0.0.0:0", "--insecure"});
  ISOSCOPE_ASSERT_OK(view);
  const absl::StatusOr<std::string> line = (*view)->WaitForOutLine("http://");
  ISOSCOPE_ASSERT_OK(line);
  const std::size_t query = line->find("/?token=");
  ASSERT_NE(query, std::string::npos) << *line;
  const std::string port =
      line->substr(line->rfind(':', query) + 1, query - line->rfind(':', query) - 1);
  const std::string token = line->substr(query + 8, 32);
  const std::string host = "127.0.0.1:" + port;
  EXPECT_EQ(Get(host, "/v1/datasets").result_int(), 401U);
  EXPECT_EQ(Get(host, "/v1/datasets?token=" + token).result_int(), 200U);
}

// As in a container, whose engine publishes the port on its host.
TEST_F(GatewayTest, APublishedPageIsForOtherMachinesAndHasTheAddressThatTheySee) {
  absl::StatusOr<std::unique_ptr<testing::Process>> view =
      testing::StartIsoscope({"view", "--server", cluster_->address()},
                             {.environment = {"ISOSCOPE_VIEW_PUBLISHED=localhost:0"}});
  ISOSCOPE_ASSERT_OK(view);
  const absl::StatusOr<std::string> line = (*view)->WaitForOutLine("http://");
  ISOSCOPE_ASSERT_OK(line);
  const std::string start = "http://localhost:";
  ASSERT_TRUE(absl::StartsWith(*line, start)) << *line;
  const std::string port = line->substr(start.size(), line->find('/', start.size()) - start.size());
  EXPECT_EQ(line->substr(start.size() + port.size(), 8), "/?token=");
  // Another address of the machine than the usual one.
  const std::string host = "127.0.0.2:" + port;
  EXPECT_EQ(Get(host, "/").result_int(), 200U);
  EXPECT_EQ(Get(host, kRender).result_int(), 401U);
  EXPECT_EQ(Get(host, kRender, {{"Authorization", "Bearer " + TokenIn(*line)}}).result_int(), 200U);
}

TEST_F(GatewayTest, APublishedPortMayBeAnotherThanTheOneThatListens) {
  absl::StatusOr<std::unique_ptr<testing::Process>> view =
      testing::StartIsoscope({"view", "--server", cluster_->address(), "--listen", "127.0.0.1:0",
                              "--published", "view.example:9000"},
                             {});
  ISOSCOPE_ASSERT_OK(view);
  const absl::StatusOr<std::string> line = (*view)->WaitForOutLine("http://");
  ISOSCOPE_ASSERT_OK(line);
  EXPECT_TRUE(absl::StartsWith(*line, "http://view.example:9000/?token=")) << *line;
}

// --- in front of fakes, in this process ---

// Renders until it is cancelled.
class EndlessService final : public v1::IsosurfaceService::Service {
 public:
  grpc::Status RenderIsosurfaceStream(
      grpc::ServerContext* context, const v1::RenderIsosurfaceStreamRequest* /*request*/,
      grpc::ServerWriter<v1::RenderIsosurfaceStreamResponse>* /*writer*/) override {
    Change(&started_);
    while (!context->IsCancelled()) {
      absl::SleepFor(absl::Milliseconds(1));
    }
    Change(&cancelled_);
    return grpc::Status::CANCELLED;
  }
  // A mesh of `mesh_pieces` pieces, then waits until it is cancelled or may end.
  grpc::Status ExportIsosurface(grpc::ServerContext* context,
                                const v1::ExportIsosurfaceRequest* /*request*/,
                                grpc::ServerWriter<v1::ExportIsosurfaceResponse>* writer) override {
    v1::ExportIsosurfaceResponse piece;
    piece.set_positions(std::string(kPieceVertices * 3 * sizeof(float), '\0'));
    piece.set_normals(piece.positions());
    for (int i = 0; i < mesh_pieces; ++i) {
      writer->Write(piece);
    }
    Change(&started_);
    while (!context->IsCancelled() && !meshes_end) {
      absl::SleepFor(absl::Milliseconds(1));
    }
    Change(&cancelled_);
    return context->IsCancelled() ? grpc::Status::CANCELLED : grpc::Status::OK;
  }
  void AwaitStarted(int count) { Await(&started_, count); }
  void AwaitCancelled(int count) { Await(&cancelled_, count); }
  [[nodiscard]] int started() {
    const base::MutexLock lock(&mutex_);
    return started_;
  }

  static constexpr std::size_t kPieceVertices = 20000;
  std::atomic<int> mesh_pieces{0};
  std::atomic<bool> meshes_end{false};

 private:
  void Change(int* counter) {
    const base::MutexLock lock(&mutex_);
    ++*counter;
    changed_.SignalAll();
  }
  void Await(const int* counter, int count) {
    base::MutexLock lock(&mutex_);
    while (*counter < count) {
      ASSERT_TRUE(changed_.WaitUntil(&mutex_, base::MonotonicNow() + testing::kPatience));
    }
  }
  base::Mutex mutex_;
  base::CondVar changed_;
  int started_ = 0;
  int cancelled_ = 0;
};

class OneDataset final : public v1::DatasetService::Service {
 public:
  grpc::Status ListDatasets(grpc::ServerContext* /*context*/,
                            const v1::ListDatasetsRequest* /*request*/,
                            v1::ListDatasetsResponse* response) override {
    response->add_datasets()->set_name("d");
    return grpc::Status::OK;
  }
  grpc::Status GetDataset(grpc::ServerContext* /*context*/, const v1::GetDatasetRequest* request,
                          v1::GetDatasetResponse* response) override {
    response->mutable_dataset()->set_name("d");
    return request->name() == "d" ? grpc::Status::OK
                                  : grpc::Status(grpc::StatusCode::NOT_FOUND, "unknown");
  }
};

// Sends frames at once, whatever is acknowledged, and keeps the numbers that are.
class FloodService final : public v1::InteractService::Service {
 public:
  static constexpr int kFrames = 60;
  static constexpr std::size_t kFrameBytes = std::size_t{1} << 20;

  grpc::Status Interact(
      grpc::ServerContext* /*context*/,
      grpc::ServerReaderWriter<v1::InteractResponse, v1::InteractRequest>* stream) override {
    v1::InteractRequest request;
    stream->Read(&request);  // the state
    std::thread writer([stream] {
      for (int number = 1; number <= kFrames; ++number) {
        v1::InteractResponse response;
        response.set_frame_number(number);
        response.mutable_frame()->set_jpeg(std::string(kFrameBytes, 'x'));
        stream->Write(response);
      }
    });
    while (stream->Read(&request)) {
      const base::MutexLock lock(&mutex_);
      shown_.push_back(request.frame_shown().frame_number());
      changed_.SignalAll();
    }
    writer.join();
    const base::MutexLock lock(&mutex_);
    ++ended_;
    changed_.SignalAll();
    return grpc::Status::OK;
  }
  // Waits until a stream has ended.
  void AwaitEnd() {
    base::MutexLock lock(&mutex_);
    while (ended_ == 0) {
      ASSERT_TRUE(changed_.WaitUntil(&mutex_, base::MonotonicNow() + testing::kPatience));
    }
  }
  // The numbers that were acknowledged, once there are `count`.
  std::vector<std::int64_t> AwaitShown(std::size_t count) {
    base::MutexLock lock(&mutex_);
    const base::MonotonicTime deadline = base::MonotonicNow() + testing::kPatience;
    while (shown_.size() < count && changed_.WaitUntil(&mutex_, deadline)) {
    }
    return shown_;
  }

 private:
  base::Mutex mutex_;
  base::CondVar changed_;
  std::vector<std::int64_t> shown_;
  int ended_ = 0;
};

class FakeBackedGateway {
 public:
  explicit FakeBackedGateway(const gateway::GatewayLimits& limits) {
    grpc::ServerBuilder builder;
    rpc::ConfigureServer(&builder);
    builder.RegisterService(&endless);
    builder.RegisterService(&datasets);
    builder.RegisterService(&flood);
    server_ = builder.BuildAndStart();
    absl::StatusOr<std::unique_ptr<gateway::GatewayServer>> started = gateway::GatewayServer::Start(
        {.channel = server_->InProcessChannel(rpc::MakeChannelArguments()),
         .listen_address = "127.0.0.1:0",
         .limits = limits});
    EXPECT_THAT(started, IsOk());
    gateway = *std::move(started);
    address = absl::StrCat("127.0.0.1:", gateway->port());
  }
  ~FakeBackedGateway() {
    gateway.reset();
    server_->Shutdown(base::MonotonicNow());
  }

  double OpenConnections() {
    for (const base::MetricFamily& family : gateway->CollectMetrics()) {
      if (family.name == "isoscope_http_connections") {
        return family.samples[0].value;
      }
    }
    ADD_FAILURE() << "no such metric";
    return 0;
  }

  EndlessService endless;
  OneDataset datasets;
  FloodService flood;
  std::unique_ptr<gateway::GatewayServer> gateway;
  std::string address;

 private:
  std::unique_ptr<grpc::Server> server_;
};

TEST(GatewayServerTest, AddressesThatCantBeListenedOnAreErrors) {
  FakeBackedGateway fakes({});
  const auto start = [](const std::string& address) {
    return gateway::GatewayServer::Start(
               {.channel = rpc::MakeChannel("127.0.0.1:1"), .listen_address = address})
        .status();
  };
  for (const char* address :
       {"", "127.0.0.1", "127.0.0.1:99999", "127.0.0.1:-1", ":80", "a b:80"}) {
    EXPECT_THAT(start(address), testing::StatusIs(absl::StatusCode::kInvalidArgument)) << address;
  }
  EXPECT_THAT(start(fakes.address),
              testing::StatusIs(absl::StatusCode::kUnavailable, HasSubstr(fakes.address)));
  EXPECT_THAT(start("192.0.2.1:0"), testing::StatusIs(absl::StatusCode::kUnavailable));
}

TEST(GatewayServerTest, AClientThatLeavesCancelsItsPicture) {
  FakeBackedGateway fakes({});
  Connection connection(fakes.address);
  connection.Send(
      absl::StrCat("POST /v1/datasets/d/render HTTP/1.1\r\nHost: localhost\r\n"
                   "Content-Length: 2\r\n\r\n{}"));
  fakes.endless.AwaitStarted(1);
  connection.Close();
  fakes.endless.AwaitCancelled(1);
}

TEST(GatewayServerTest, MorePicturesThanTheLimitAreRefused) {
  FakeBackedGateway fakes({.max_pictures = 1});
  Connection first(fakes.address);
  first.Send(
      "POST /v1/datasets/d/render HTTP/1.1\r\nHost: localhost\r\nContent-Length: 2\r\n\r\n{}");
  fakes.endless.AwaitStarted(1);
  const auto refused = Post(fakes.address, "/v1/datasets/d/render", "{}");
  EXPECT_EQ(refused.result_int(), 429U);
  EXPECT_EQ(HeaderOf(refused, "Retry-After"), "1");
  // Facts are still told.
  EXPECT_EQ(Get(fakes.address, "/v1/datasets").result_int(), 200U);
}

constexpr char kMesh[] = "/v1/datasets/d/mesh.glb?isovalue=1";

std::string GetMesh(const std::string& more = "") {
  return absl::StrCat("GET ", kMesh, " HTTP/1.1\r\nHost: localhost\r\n", more, "\r\n");
}

// Asks until another status than `status` comes.
http::response<http::string_body> GetUntilNot(unsigned status, const std::string& address,
                                              const std::string& target) {
  const base::MonotonicTime deadline = base::MonotonicNow() + testing::kPatience;
  auto response = Get(address, target);
  while (response.result_int() == status && base::MonotonicNow() < deadline) {
    absl::SleepFor(absl::Milliseconds(10));
    response = Get(address, target);
  }
  return response;
}

TEST(GatewayServerTest, HeadOfAMeshEndsItsExportWithTheFirstPiece) {
  FakeBackedGateway fakes({.max_caller_meshes = 1});
  fakes.endless.mesh_pieces = 1;
  const auto ask = [&](const std::string& target) {
    return Connection(fakes.address)
        .Ask(MakeRequest(fakes.address, http::verb::head, target, {}, ""));
  };
  EXPECT_EQ(ask("/v1/datasets/d/mesh.glb").result_int(), 400U);
  EXPECT_EQ(ask("/v1/datasets/e/mesh.glb?isovalue=1").result_int(), 404U);
  EXPECT_EQ(fakes.endless.started(), 0);
  const auto answer = ask(kMesh);
  EXPECT_EQ(answer.result_int(), 200U);
  EXPECT_EQ(HeaderOf(answer, "Content-Type"), "model/gltf-binary");
  fakes.endless.AwaitCancelled(1);
  // Its place among the caller's meshes is free, soon after the coordinator has heard of the end.
  const base::MonotonicTime deadline = base::MonotonicNow() + testing::kPatience;
  unsigned next = ask(kMesh).result_int();
  while (next == 429 && base::MonotonicNow() < deadline) {
    next = ask(kMesh).result_int();
  }
  EXPECT_EQ(next, 200U);
}

TEST(GatewayServerTest, ACallerHasFewMeshesInWorkAndOthersTheirOwn) {
  FakeBackedGateway fakes({.max_caller_meshes = 1});
  Connection first(fakes.address);
  first.Send(GetMesh("Authorization: Bearer a\r\n"));
  fakes.endless.AwaitStarted(1);
  const auto refused = Get(fakes.address, kMesh, {{"Authorization", "Bearer a"}});
  EXPECT_EQ(refused.result_int(), 429U);
  EXPECT_NE(HeaderOf(refused, "Retry-After"), "");
  EXPECT_THAT(refused.body(), HasSubstr("--max-caller-meshes"));
  // The coordinator knows another token, and those without one have their address.
  Connection second(fakes.address);
  second.Send(GetMesh("Authorization: Bearer b\r\n"));
  fakes.endless.AwaitStarted(2);
  Connection third(fakes.address);
  third.Send(GetMesh());
  fakes.endless.AwaitStarted(3);
  EXPECT_EQ(Get(fakes.address, kMesh).result_int(), 429U);
  // The place of one that leaves is free.
  third.Close();
  fakes.endless.AwaitCancelled(1);
  fakes.endless.meshes_end = true;
  EXPECT_EQ(GetUntilNot(429, fakes.address, kMesh).result_int(), 200U);
}

TEST(GatewayServerTest, MeshesInWorkKeepToTheDiskSpace) {
  // 20000 vertices are 480 KB, and while a file is put together 720 KB.
  FakeBackedGateway fakes({.max_mesh_bytes = 1'000'000});
  fakes.endless.mesh_pieces = 1;
  Connection first(fakes.address);
  Connection second(fakes.address);
  first.Send(GetMesh("Connection: close\r\n"));
  second.Send(GetMesh("Connection: close\r\n"));
  const base::MonotonicTime deadline = base::MonotonicNow() + testing::kPatience;
  while (first.socket().available() + second.socket().available() == 0 &&
         base::MonotonicNow() < deadline) {
    absl::SleepFor(absl::Milliseconds(1));
  }
  // Either of them.
  Connection& refused = first.socket().available() > 0 ? first : second;
  Connection& in_work = first.socket().available() > 0 ? second : first;
  EXPECT_THAT(refused.ReadAll(), AllOf(StartsWith("HTTP/1.1 429"), HasSubstr("Retry-After: "),
                                       HasSubstr("--max-mesh-bytes")));
  in_work.Close();
  fakes.endless.AwaitCancelled(2);
  fakes.endless.meshes_end = true;
  EXPECT_EQ(GetUntilNot(429, fakes.address, kMesh).result_int(), 200U);
  // One that never fits is not to be asked for again.
  fakes.endless.mesh_pieces = 2;
  // The gateway may still hold the space of the one that was read just now.
  auto too_large = Get(fakes.address, kMesh);
  while (HeaderOf(too_large, "Retry-After") != "" && base::MonotonicNow() < deadline) {
    too_large = Get(fakes.address, kMesh);
  }
  EXPECT_EQ(too_large.result_int(), 429U);
  EXPECT_EQ(HeaderOf(too_large, "Retry-After"), "");
  EXPECT_THAT(too_large.body(), HasSubstr("isoscope export"));
}

TEST(GatewayServerTest, AMeshThatIsNotReadYetCountsUntilItIsSent) {
  FakeBackedGateway fakes({.max_caller_meshes = 1});
  // More than the buffers of two sockets hold.
  fakes.endless.mesh_pieces = 80;
  fakes.endless.meshes_end = true;
  Connection first(fakes.address);
  first.Send(GetMesh("Connection: close\r\n"));
  fakes.endless.AwaitCancelled(1);
  EXPECT_EQ(Get(fakes.address, kMesh).result_int(), 429U);
  EXPECT_GT(first.ReadAll().size(), 80 * EndlessService::kPieceVertices * 24);
  EXPECT_EQ(GetUntilNot(429, fakes.address, kMesh).result_int(), 200U);
}

// Each piece is taken in time, but all of them would take hours.
TEST(GatewayServerTest, AClientThatTakesAnAnswerByTheByteIsDropped) {
  FakeBackedGateway fakes({.write_timeout = absl::Milliseconds(500), .min_bytes_per_second = 1e9});
  fakes.endless.mesh_pieces = 80;
  fakes.endless.meshes_end = true;
  Connection slow(fakes.address);
  slow.socket().set_option(tcp::socket::receive_buffer_size(4096));
  slow.Send(GetMesh("Connection: close\r\n"));
  std::size_t taken = 0;
  error_code error;
  std::string bytes(1000, ' ');
  do {
    taken += slow.socket().read_some(asio::buffer(bytes), error);
    absl::SleepFor(absl::Milliseconds(5));
  } while (!error && fakes.OpenConnections() > 0);
  EXPECT_EQ(fakes.OpenConnections(), 0);
  // The buffers of the two sockets hold the rest of what was sent: taking it by such a small window lasts minutes.
  constexpr std::size_t kBufferBytes = std::size_t{16} << 20;
  EXPECT_LT(taken + kBufferBytes, 80 * EndlessService::kPieceVertices * 24);
}

TEST(GatewayServerTest, MoreWorkThanTheLimitIsRefusedAndConnectionsThatWaitAreNoWork) {
  FakeBackedGateway fakes({.max_connections = 2});
  Connection waiting(fakes.address);
  Connection other(fakes.address);
  EXPECT_EQ(Get(fakes.address, "/").result_int(), 200U);
  // An answered request may hold its place a moment longer.
  const auto view = [&fakes] {
    const base::MonotonicTime deadline = base::MonotonicNow() + testing::kPatience;
    auto viewer = std::make_unique<Viewer>(fakes.address);
    while (viewer->status() == 429 && base::MonotonicNow() < deadline) {
      absl::SleepFor(absl::Milliseconds(10));
      viewer = std::make_unique<Viewer>(fakes.address);
    }
    return viewer;
  };
  const auto first = view();
  const auto second = view();
  const auto refused = Get(fakes.address, "/");
  EXPECT_EQ(refused.result_int(), 429U);
  EXPECT_THAT(refused.body(), HasSubstr("--max-connections"));
  EXPECT_NE(HeaderOf(refused, "Retry-After"), "");
  EXPECT_EQ(Get(fakes.address, "/healthz").result_int(), 503U) << "which is the coordinator's";
  first->Drop();
  EXPECT_EQ(GetUntilNot(429, fakes.address, "/").result_int(), 200U);
}

// Symptom: half-sent bodies of requests for health held all of its places.
TEST(GatewayServerTest, HealthIsAnsweredWithoutTheBodyThatARequestAnnounces) {
  FakeBackedGateway fakes({.request_timeout = absl::Minutes(5)});
  Connection half(fakes.address);
  half.Send("GET /healthz HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9\r\n\r\n");
  EXPECT_THAT(half.ReadAll(), StartsWith("HTTP/1.1 503")) << "which is the coordinator's";
}

TEST(GatewayServerTest, SlowRequestsAreDropped) {
  FakeBackedGateway fakes({.request_timeout = absl::Milliseconds(100)});
  Connection silent(fakes.address);
  EXPECT_EQ(silent.ReadAll(), "");
  Connection half_header(fakes.address);
  half_header.Send("GET / HTTP/1.1\r\nHost: lo");
  EXPECT_EQ(half_header.ReadAll(), "");
  Connection half_body(fakes.address);
  half_body.Send(
      "POST /v1/datasets/d/pick HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9\r\n\r\n{");
  EXPECT_EQ(half_body.ReadAll(), "");
}

// The request itself has all the time that a machine under load may take.
TEST(GatewayServerTest, ConnectionsThatAreIdleAfterAnAnswerAreClosed) {
  FakeBackedGateway fakes({.idle_timeout = absl::Milliseconds(100)});
  Connection idle(fakes.address);
  idle.Send("GET /v1/interact HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_THAT(idle.ReadAll(), StartsWith("HTTP/1.1 426"));
}

TEST(GatewayServerTest, FramesThatAreReplacedAreAcknowledgedOnceAndTheLastOneComes) {
  FakeBackedGateway fakes({});
  Viewer viewer(fakes.address);
  ASSERT_EQ(viewer.status(), 101U);
  viewer.SendState(1, "{}", false);
  // Nothing is read while frames come, so most of them are replaced.
  std::vector<std::int64_t> shown = fakes.flood.AwaitShown(FloodService::kFrames / 2);
  std::set<std::int64_t> received;
  std::optional<Frame> frame = viewer.Read();
  while (frame && frame->number() < FloodService::kFrames) {
    received.insert(frame->number());
    frame = viewer.Read();
  }
  ASSERT_TRUE(frame.has_value());
  received.insert(frame->number());
  shown = fakes.flood.AwaitShown(FloodService::kFrames - received.size());
  EXPECT_EQ(shown.size() + received.size(), static_cast<std::size_t>(FloodService::kFrames));
  for (const std::int64_t number : shown) {
    EXPECT_EQ(received.count(number), 0U) << number;
    received.insert(number);
  }
  EXPECT_EQ(received.size(), static_cast<std::size_t>(FloodService::kFrames));
}

TEST(GatewayServerTest, AViewerThatDoesNotReadIsDroppedAndOthersGoOn) {
  // The one that reads keeps to it, on a machine under load, too.
  FakeBackedGateway fakes({.write_timeout = absl::Seconds(5)});
  Viewer stalled(fakes.address);
  stalled.SendState(1, "{}", false);
  Viewer other(fakes.address);
  other.SendState(1, "{}", false);
  std::optional<Frame> frame = other.Read();
  while (frame && frame->number() < FloodService::kFrames) {
    frame = other.Read();
  }
  ASSERT_TRUE(frame.has_value());
  fakes.flood.AwaitEnd();
  // Data in the buffers of the sockets still arrives, and then the end without a close.
  EXPECT_EQ(stalled.ReadClose().first, 0);
}

}  // namespace
}  // namespace isoscope
