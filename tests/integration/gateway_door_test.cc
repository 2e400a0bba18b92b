// The gateway's door: real sockets of strangers that send nothing, half of something, or nonsense,
// and who gets in beside them. The coordinator behind it is made up.

#include <algorithm>
#include <atomic>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <grpcpp/server_builder.h>

#include "core/base/monotonic_time.h"
#include "isoscope/v1/cluster_service.grpc.pb.h"
#include "isoscope/v1/dataset_service.grpc.pb.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "rpc/channel.h"
#include "rpc/grpc_time.h"
#include "tests/support/enough_time.h"
#include "tests/support/process.h"
#include "tests/support/raw_connection.h"
#include "tests/support/status_matchers.h"
#include "web-gateway/gateway_server.h"
#include "web-gateway/health_request.h"

namespace isoscope {
namespace {

namespace v1 = isoscope::v1;
using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::HasSubstr;
using testing::IsOk;
using testing::kPatience;
using ::testing::Not;
using testing::RawConnection;
using ::testing::StartsWith;

constexpr char kToken[] = "s3cret";

// Knows the token kToken where `asks_token`.
bool IsCaller(const grpc::ServerContext& context, bool asks_token) {
  const auto found = context.client_metadata().find("authorization");
  return !asks_token || (found != context.client_metadata().end() &&
                         found->second == absl::StrCat("Bearer ", kToken));
}

const grpc::Status kUnknownCaller(grpc::StatusCode::UNAUTHENTICATED, "unknown");

class Cluster final : public v1::ClusterService::Service {
 public:
  grpc::Status GetCapabilities(grpc::ServerContext* /*context*/,
                               const v1::GetCapabilitiesRequest* /*request*/,
                               v1::GetCapabilitiesResponse* /*response*/) override {
    return grpc::Status::OK;
  }
};

class Datasets final : public v1::DatasetService::Service {
 public:
  grpc::Status ListDatasets(grpc::ServerContext* context,
                            const v1::ListDatasetsRequest* /*request*/,
                            v1::ListDatasetsResponse* response) override {
    if (!IsCaller(*context, asks_token)) {
      return kUnknownCaller;
    }
    response->add_datasets()->set_name("d");
    return grpc::Status::OK;
  }
  grpc::Status GetDataset(grpc::ServerContext* context, const v1::GetDatasetRequest* request,
                          v1::GetDatasetResponse* response) override {
    if (!IsCaller(*context, asks_token)) {
      return kUnknownCaller;
    }
    response->mutable_dataset()->set_name("d");
    return request->name() == "d" ? grpc::Status::OK
                                  : grpc::Status(grpc::StatusCode::NOT_FOUND, "unknown");
  }
  std::atomic<bool> asks_token{false};
};

class Surfaces final : public v1::IsosurfaceService::Service {
 public:
  // Sends `pieces` pieces of one vertex, or signs of life; then ends with `end`.
  grpc::Status ExportIsosurface(grpc::ServerContext* context,
                                const v1::ExportIsosurfaceRequest* /*request*/,
                                grpc::ServerWriter<v1::ExportIsosurfaceResponse>* writer) override {
    v1::ExportIsosurfaceResponse piece;
    if (has_vertices) {
      piece.set_positions(std::string(3 * sizeof(float), '\0'));
      piece.set_normals(piece.positions());
    }
    for (int i = 0; i < pieces && !context->IsCancelled(); ++i) {
      sent_pieces += writer->Write(piece) ? 1 : 0;
    }
    return {static_cast<grpc::StatusCode>(end.load()), "as the test says"};
  }
  std::atomic<int> pieces{0};
  std::atomic<bool> has_vertices{true};
  std::atomic<int> sent_pieces{0};
  std::atomic<int> end{0};
};

class Gateway {
 public:
  explicit Gateway(gateway::GatewayOptions options) {
    testing::RaiseFileLimit();
    grpc::ServerBuilder builder;
    rpc::ConfigureServer(&builder);
    builder.RegisterService(&cluster_);
    builder.RegisterService(&datasets);
    builder.RegisterService(&surfaces);
    coordinator_ = builder.BuildAndStart();
    datasets.asks_token = options.access.has_user_tokens;
    options.channel = coordinator_->InProcessChannel(rpc::MakeChannelArguments());
    options.listen_address = "127.0.0.1:0";
    absl::StatusOr<std::unique_ptr<gateway::GatewayServer>> started =
        gateway::GatewayServer::Start(options);
    EXPECT_THAT(started, IsOk());
    server_ = *std::move(started);
  }
  ~Gateway() {
    server_.reset();
    coordinator_->Shutdown(base::MonotonicNow());
  }

  [[nodiscard]] int port() const { return server_->port(); }
  [[nodiscard]] std::string address() const { return absl::StrCat("127.0.0.1:", port()); }
  // The whole answer to `request`, on a connection of its own.
  [[nodiscard]] std::string Ask(const std::string& request,
                                const char* source = "127.0.0.1") const {
    RawConnection connection(port(), source);
    connection.Send(request);
    return connection.ReadAnswer(absl::StartsWith(request, "HEAD"));
  }
  [[nodiscard]] double Metric(const std::string& name) const {
    for (const base::MetricFamily& family : server_->CollectMetrics()) {
      if (family.name == name) {
        return family.samples[0].value;
      }
    }
    ADD_FAILURE() << name;
    return 0;
  }
  // Waits until the gateway has `count` connections.
  void AwaitConnections(int count) const {
    const base::MonotonicTime deadline = base::MonotonicNow() + kPatience;
    while (Metric("isoscope_http_connections") != count && base::MonotonicNow() < deadline) {
      absl::SleepFor(absl::Milliseconds(5));
    }
    ASSERT_EQ(Metric("isoscope_http_connections"), count);
  }

  Datasets datasets;
  Surfaces surfaces;

 private:
  Cluster cluster_;
  std::unique_ptr<grpc::Server> coordinator_;
  std::unique_ptr<gateway::GatewayServer> server_;
};

gateway::GatewayOptions WithToken() {
  gateway::GatewayOptions options;
  options.access.token = kToken;
  return options;
}

std::string Get(const std::string& target, const std::string& fields = "") {
  return absl::StrCat("GET ", target, " HTTP/1.1\r\nHost: localhost\r\n", fields, "\r\n");
}

std::string GetWithToken(const std::string& target) {
  return Get(target, absl::StrCat("Authorization: Bearer ", kToken, "\r\n"));
}

// What half-open connections have sent.
const std::vector<std::string> kHalves = {
    "", "G", "GET / HTTP/1.1\r\nHost: localhost\r\n", "GET / HTTP/1.1\r\nX: ",
    "GET /v1/interact HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upg"};

std::vector<RawConnection> OpenHalf(int port, int count, const char* source = "127.0.0.1") {
  std::vector<RawConnection> half;
  half.reserve(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) {
    half.emplace_back(port, source).Send(kHalves[static_cast<std::size_t>(i) % kHalves.size()]);
  }
  return half;
}

TEST(GatewayDoorTest, AThousandHalfOpenConnectionsShutNobodyOut) {
  Gateway gateway(WithToken());
  RawConnection kept(gateway.port(), "127.0.0.5");
  kept.Send(GetWithToken("/v1/datasets"));
  ASSERT_THAT(kept.ReadAnswer(), StartsWith("HTTP/1.1 200"));
  const std::vector<RawConnection> half = OpenHalf(gateway.port(), 1000);
  // Of the same address, of another one, and by the probe of a container.
  for (const char* source : {"127.0.0.1", "127.0.0.2"}) {
    EXPECT_THAT(gateway.Ask(Get("/healthz"), source), StartsWith("HTTP/1.1 200")) << source;
    EXPECT_THAT(gateway.Ask(GetWithToken("/v1/datasets"), source), StartsWith("HTTP/1.1 200"))
        << source;
    EXPECT_THAT(gateway.Ask(Get("/"), source), StartsWith("HTTP/1.1 200")) << source;
  }
  EXPECT_THAT(gateway::AskHealth({.address = gateway.address()}), IsOk());
  kept.Send(GetWithToken("/v1/datasets"));
  EXPECT_THAT(kept.ReadAnswer(), StartsWith("HTTP/1.1 200")) << "who showed a token is kept";
  EXPECT_LE(gateway.Metric("isoscope_http_connections"), 256 + 32);
  EXPECT_GE(gateway.Metric("isoscope_http_dropped_connections_total"), 1000 - 256 - 32);
  EXPECT_EQ(gateway.Metric("isoscope_http_refused_connections_total"), 0);
}

TEST(GatewayDoorTest, AFloodFromManyAddressesShutsNobodyOut) {
  Gateway gateway(WithToken());
  std::vector<RawConnection> half;
  for (int i = 0; i < 600; ++i) {
    half.emplace_back(gateway.port(), absl::StrCat("127.1.", i / 200, ".", 1 + i % 200).c_str());
  }
  EXPECT_THAT(gateway.Ask(Get("/healthz"), "127.0.0.2"), StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(gateway.Ask(GetWithToken("/v1/datasets"), "127.0.0.3"), StartsWith("HTTP/1.1 200"));
}

TEST(GatewayDoorTest, ThoseThatReadNoAnswerFillNoMoreThanTheirShare) {
  gateway::GatewayOptions options = WithToken();
  options.limits.max_connections = 16;
  Gateway gateway(options);
  // Each asks for more than the buffers of two sockets hold, and reads nothing.
  std::string pages;
  for (int i = 0; i < 800; ++i) {
    pages += Get("/view/overlay.js");
  }
  std::vector<RawConnection> deaf;
  for (int i = 0; i < 40; ++i) {
    const int size = 4096;
    RawConnection& connection = deaf.emplace_back(gateway.port());
    setsockopt(connection.socket(), SOL_SOCKET, SO_RCVBUF, &size, sizeof(size));
    connection.Send(pages);
  }
  EXPECT_THAT(gateway.Ask(Get("/"), "127.0.0.2"), StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(gateway.Ask(Get("/healthz"), "127.0.0.1"), StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(gateway.Ask(GetWithToken("/v1/datasets"), "127.0.0.1"), StartsWith("HTTP/1.1 200"));
}

// A request whose body is expected and does not come: it stays in work. Returns whether it found a
// place, else the first line of the answer.
std::string BeginWork(RawConnection* connection, const std::string& fields,
                      const std::string& target = "/v1/datasets/d/pick") {
  connection->Send(absl::StrCat("POST ", target, " HTTP/1.1\r\nHost: localhost\r\n", fields,
                                "Content-Length: 9\r\nExpect: 100-continue\r\n\r\n"));
  const std::string answer = connection->ReadAnswer();
  return answer.substr(0, answer.find("\r\n"));
}

constexpr char kContinue[] = "HTTP/1.1 100 Continue";

TEST(GatewayDoorTest, AStrangersBodyIsNotRead) {
  Gateway gateway(WithToken());
  RawConnection connection(gateway.port());
  connection.Send(
      "POST /v1/datasets/d/pick HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000000\r\n\r\n");
  EXPECT_THAT(connection.ReadAnswer(),
              AllOf(StartsWith("HTTP/1.1 401"), HasSubstr("\r\nConnection: close\r\n")));
}

TEST(GatewayDoorTest, AUsersTokenCountsOnceTheCoordinatorHasAcceptedIt) {
  gateway::GatewayOptions options;
  options.access.has_user_tokens = true;
  options.limits.max_connections = 4;  // one of them for known callers
  Gateway gateway(options);
  const auto ask = [&](const std::string& token, const char* source) {
    return gateway.Ask(Get("/v1/datasets", absl::StrCat("Authorization: Bearer ", token, "\r\n")),
                       source);
  };
  EXPECT_THAT(ask(kToken, "127.0.0.1"), StartsWith("HTTP/1.1 200"));
  std::vector<RawConnection> strangers;
  for (int i = 0; i < 4; ++i) {
    strangers.emplace_back(gateway.port(), absl::StrCat("127.2.0.", i + 1).c_str());
    EXPECT_THAT(BeginWork(&strangers.back(), "Authorization: Bearer guess\r\n"),
                StartsWith(i < 3 ? kContinue : "HTTP/1.1 503"));
  }
  EXPECT_THAT(ask("guess", "127.0.0.2"),
              AllOf(StartsWith("HTTP/1.1 503"), HasSubstr("Retry-After")));
  EXPECT_THAT(ask(kToken, "127.0.0.2"), StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(gateway.Ask(Get("/healthz"), "127.0.0.2"), StartsWith("HTTP/1.1 200"));
}

TEST(GatewayDoorTest, BehindAProxyEachCallerHasItsShare) {
  gateway::GatewayOptions options = WithToken();
  options.limits.max_connections = 8;  // of which a stranger's address gets two
  ASSERT_THAT(options.trusted_proxies.Add("127.0.0.9"), IsOk());
  Gateway gateway(options);
  const auto begin = [](RawConnection* connection, const std::string& caller) {
    return BeginWork(connection, absl::StrCat("X-Forwarded-For: 1.1.1.1, ", caller, "\r\n"),
                     "/none");
  };
  std::vector<RawConnection> strangers;
  for (int i = 0; i < 3; ++i) {
    strangers.emplace_back(gateway.port(), "127.0.0.9");
    EXPECT_THAT(begin(&strangers.back(), "192.0.2.7"),
                StartsWith(i < 2 ? kContinue : "HTTP/1.1 429"));
  }
  RawConnection other(gateway.port(), "127.0.0.9");
  other.Send(Get("/", "X-Forwarded-For: 192.0.2.8\r\n"));
  EXPECT_THAT(other.ReadAnswer(), StartsWith("HTTP/1.1 200"));
  // Whoever is no proxy has its own address, whatever it says.
  for (int i = 0; i < 3; ++i) {
    strangers.emplace_back(gateway.port(), "127.0.0.8");
    EXPECT_THAT(begin(&strangers.back(), absl::StrCat("192.0.2.", 100 + i)),
                StartsWith(i < 2 ? kContinue : "HTTP/1.1 429"));
  }
  // Connections of the proxy that wait make room one by one, as those of many addresses.
  std::vector<RawConnection> idle = OpenHalf(gateway.port(), 100, "127.0.0.9");
  EXPECT_THAT(gateway.Ask(Get("/healthz"), "127.0.0.2"), StartsWith("HTTP/1.1 200"));
}

TEST(GatewayDoorTest, WhereNoTokenIsAskedForAnotherAddressFindsAPlace) {
  gateway::GatewayOptions options;
  options.limits.max_connections = 8;
  Gateway gateway(options);
  std::vector<RawConnection> strangers;
  for (int i = 0; i < 7; ++i) {
    strangers.emplace_back(gateway.port());
    EXPECT_THAT(BeginWork(&strangers.back(), ""), StartsWith(i < 6 ? kContinue : "HTTP/1.1 429"));
  }
  EXPECT_THAT(gateway.Ask(Get("/v1/datasets"), "127.0.0.2"), StartsWith("HTTP/1.1 200"));
}

TEST(GatewayDoorTest, ASlowHeaderHasItsOwnTimeAfterAnAnswer) {
  testing::WithEnoughTime(absl::Milliseconds(200), [](absl::Duration time) {
    gateway::GatewayOptions options;
    options.limits.request_timeout = time;
    options.limits.idle_timeout = kPatience * 10;
    Gateway gateway(options);
    RawConnection connection(gateway.port());
    connection.Send(Get("/healthz"));
    const std::string answer = connection.ReadAnswer();
    if (answer.empty()) {  // the whole request was late
      return false;
    }
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
    connection.Send("GET /healthz HTTP/1.1\r\nHo");
    EXPECT_EQ(connection.ReadAll(), "");
    return true;
  });
}

// RFC 9110, 9112 and 6455, by section where a rule is not plain.
TEST(GatewayDoorTest, RequestsAreAnsweredByTheRulesOfHttp) {
  Gateway gateway({});
  const std::string long_name(300, 'x');
  const struct {
    std::string request;
    const char* answer;
  } cases[] = {
      // The host.
      {"GET /healthz HTTP/1.1\r\n\r\n", "HTTP/1.1 400"},
      {"GET /healthz HTTP/1.0\r\n\r\n", "HTTP/1.1 403"},  // no name that is known here
      {"GET /healthz HTTP/1.1\r\nHost:\r\n\r\n", "HTTP/1.1 400"},
      {Get("/healthz", "Host: localhost\r\n"), "HTTP/1.1 400"},
      {Get("http://localhost/healthz"), "HTTP/1.1 200"},
      {Get("http://evil.org/healthz"), "HTTP/1.1 403"},  // 9112, 3.2.2: the address counts
      {"GET http://localhost/healthz HTTP/1.1\r\nHost: evil.org\r\n\r\n", "HTTP/1.1 200"},
      // Fields that a request has once.
      {Get("/healthz", "Authorization: Bearer a\r\nauthorization: Bearer b\r\n"), "HTTP/1.1 400"},
      {Get("/healthz", "Origin: http://localhost\r\nOrigin: http://evil.org\r\n"), "HTTP/1.1 400"},
      {Get("/healthz", "Content-Length: 0\r\nContent-Length: 1\r\n"), "HTTP/1.1 400"},
      // Bodies, 9112, 6.
      {Get("/healthz", "Content-Length: 3\r\nTransfer-Encoding: chunked\r\n") + "0\r\n\r\n",
       "HTTP/1.1 400"},
      {Get("/healthz", "Transfer-Encoding: chunked\r\nContent-Length: 3\r\n") + "0\r\n\r\n",
       "HTTP/1.1 400"},
      {Get("/healthz", "Content-Length: -1\r\n"), "HTTP/1.1 400"},
      {Get("/healthz", "Content-Length: +1\r\n"), "HTTP/1.1 400"},
      {Get("/healthz", "Content-Length: 1, 2\r\n"), "HTTP/1.1 400"},
      {Get("/healthz", "Transfer-Encoding: gzip, chunked\r\n") + "0\r\n\r\n", "HTTP/1.1 501"},
      {Get("/healthz", "Transfer-Encoding: chunked\r\n") + "0\r\n\r\n", "HTTP/1.1 200"},
      {"GET /healthz HTTP/1.0\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
       "HTTP/1.1 400"},
      // The syntax of the header, 9112, 5.
      {"GET /healthz HTTP/1.1\r\nHost : localhost\r\n\r\n", "HTTP/1.1 400"},
      {"GET /healthz HTTP/1.1\r\n Host: localhost\r\n\r\n", "HTTP/1.1 400"},
      {Get("/healthz", "X: a\r\n b\r\n"), "HTTP/1.1 200"},  // obs-fold may be read as a space
      {Get("/healthz", std::string("X: a\0b\r\n", 8)), "HTTP/1.1 400"},
      {"GET /healthz HTTP/2.0\r\nHost: localhost\r\n\r\n", "HTTP/1.1 505"},
      {"GET /healthz\r\n\r\n", "HTTP/1.1 400"},
      // Expectations, 9110, 10.1.1.
      {Get("/healthz", "Expect: 100-continue\r\n"), "HTTP/1.1 200"},
      {Get("/healthz", "Expect: tea\r\n"), "HTTP/1.1 417"},
      {Get("/healthz", "Expect: 100-continue\r\nExpect: tea\r\n"), "HTTP/1.1 417"},
      // Addresses.
      {Get("/%00"), "HTTP/1.1 400"},
      {Get("/%ff"), "HTTP/1.1 400"},
      {Get("/a%0d%0ab"), "HTTP/1.1 400"},
      {Get("/%2e%2e/etc/passwd"), "HTTP/1.1 400"},
      {Get("//healthz//"), "HTTP/1.1 200"},
      {Get("/v1/datasets/"), "HTTP/1.1 200"},
      {Get("*"), "HTTP/1.1 400"},
      {absl::StrReplaceAll(Get("*"), {{"GET", "OPTIONS"}}), "HTTP/1.1 204"},
      // Methods.
      {absl::StrReplaceAll(Get("/healthz"), {{"GET", "TRACE"}}), "HTTP/1.1 405"},
      {absl::StrReplaceAll(Get("/healthz"), {{"GET", "get"}}), "HTTP/1.1 405"},
      {"CONNECT localhost:80 HTTP/1.1\r\nHost: localhost\r\n\r\n", "HTTP/1.1 400"},
      // Ranges need not be served, 9110, 14.2.
      {Get("/index.html", "Range: bytes=0-1\r\n"), "HTTP/1.1 200"},
      // A WebSocket, 6455, 4.2.
      {Get("/v1/interact"), "HTTP/1.1 426"},
      {Get("/v1/interact",
           "Connection: Upgrade\r\nUpgrade: websocket\r\n"
           "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
           "Sec-WebSocket-Version: 8\r\n"),
       "HTTP/1.1 426"},
      {Get("/v1/interact",
           "Connection: Upgrade\r\nUpgrade: websocket\r\nContent-Length: 3\r\n"
           "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
           "Sec-WebSocket-Version: 13\r\n"),
       "HTTP/1.1 400"},
  };
  for (const auto& c : cases) {
    EXPECT_THAT(gateway.Ask(c.request), StartsWith(c.answer)) << c.request;
  }
  EXPECT_THAT(gateway.Ask(Get("/healthz")), StartsWith("HTTP/1.1 200"));
}

TEST(GatewayDoorTest, AnAnswerNamesTheMethodsThatItsAddressTakes) {
  Gateway gateway({});
  const auto allow = [&](const std::string& method, const std::string& target) {
    const std::string answer =
        gateway.Ask(absl::StrCat(method, " ", target, " HTTP/1.1\r\nHost: localhost\r\n\r\n"));
    const std::size_t begin = answer.find("\r\nAllow: ");
    return begin == std::string::npos
               ? answer.substr(0, 12)
               : answer.substr(begin + 9, answer.find("\r\n", begin + 2) - begin - 9);
  };
  EXPECT_EQ(allow("PUT", "/"), "GET, HEAD");
  EXPECT_EQ(allow("PUT", "/v1/datasets"), "GET, HEAD");
  EXPECT_EQ(allow("PUT", "/v1/datasets/d/render"), "GET, HEAD, POST");
  EXPECT_EQ(allow("GET", "/v1/datasets/d/pick"), "POST");
  EXPECT_EQ(allow("HEAD", "/v1/datasets/d/pick"), "POST");
  EXPECT_EQ(allow("OPTIONS", "/v1/datasets"), "GET, HEAD, POST, OPTIONS");
}

TEST(GatewayDoorTest, AClientThatWaitsForItIsToldToContinue) {
  Gateway gateway({});
  RawConnection connection(gateway.port());
  connection.Send(
      "POST /v1/datasets/d/pick HTTP/1.1\r\nHost: localhost\r\nContent-Length: 4\r\n"
      "Expect: 100-continue\r\n\r\n");
  EXPECT_EQ(connection.ReadAnswer(), "HTTP/1.1 100 Continue\r\n\r\n");
  connection.Send("nope");
  EXPECT_THAT(connection.ReadAnswer(),
              AllOf(StartsWith("HTTP/1.1 400"), HasSubstr("PickSurfaceRequest")));
  // 9110, 10.1.1: one that sends its body at once, one with HTTP/1.0, and one that is refused.
  connection.Send(
      "POST /v1/datasets/d/pick HTTP/1.1\r\nHost: localhost\r\nContent-Length: 4\r\n"
      "Expect: 100-continue\r\n\r\nnope");
  EXPECT_THAT(connection.ReadAnswer(),
              AnyOf(StartsWith("HTTP/1.1 400"), StartsWith("HTTP/1.1 100")));
  EXPECT_THAT(gateway.Ask("POST /v1/datasets/d/pick HTTP/1.0\r\nHost: localhost\r\n"
                          "Content-Length: 4\r\nExpect: 100-continue\r\n\r\nnope"),
              StartsWith("HTTP/1.1 400"));
  EXPECT_THAT(gateway.Ask("POST /v1/datasets/d/pick HTTP/1.1\r\nHost: evil.org\r\n"
                          "Content-Length: 4\r\nExpect: 100-continue\r\n\r\n"),
              StartsWith("HTTP/1.1 403"));
}

TEST(GatewayDoorTest, ListsInSeveralFieldsAreOneList) {
  Gateway gateway(WithToken());
  std::string bearer = absl::WebSafeBase64Escape(kToken);
  RawConnection socket(gateway.port());
  // The protocols in two lines, and the connection's options in two.
  socket.Send(
      Get("/v1/interact", absl::StrCat("Connection: keep-alive\r\nConnection: Upgrade\r\n"
                                       "Upgrade: websocket\r\nSec-WebSocket-Protocol: isoscope\r\n"
                                       "Sec-WebSocket-Protocol: isoscope.bearer.",
                                       bearer,
                                       "\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
                                       "Sec-WebSocket-Version: 13\r\n")));
  EXPECT_THAT(socket.ReadAnswer(), AllOf(StartsWith("HTTP/1.1 101"),
                                         HasSubstr("\r\nSec-WebSocket-Protocol: isoscope\r\n"),
                                         HasSubstr("s3pPLMBiTxaQ9kYGzzhZRbK+xOo=")));
  // Tags that a client has.
  const std::string page = gateway.Ask(Get("/"));
  const std::size_t tag = page.find("\r\nETag: ") + 8;
  const std::string etag = page.substr(tag, page.find("\r\n", tag) - tag);
  EXPECT_THAT(gateway.Ask(Get(
                  "/", absl::StrCat("If-None-Match: \"other\"\r\nIf-None-Match: ", etag, "\r\n"))),
              StartsWith("HTTP/1.1 304"));
  // An end that is said in a second field.
  RawConnection ending(gateway.port());
  ending.Send(Get("/healthz", "Connection: x\r\nConnection: close\r\n"));
  EXPECT_THAT(ending.ReadAll(), HasSubstr("\r\nConnection: close\r\n"));
}

// The status and the header, without what names the request.
std::string HeadOf(const std::string& answer) {
  std::string head;
  for (const absl::string_view line :
       absl::StrSplit(answer.substr(0, answer.find("\r\n\r\n")), "\r\n")) {
    const std::string lower = absl::AsciiStrToLower(line);
    if (!absl::StartsWith(lower, "x-request-id") && !absl::StartsWith(lower, "traceresponse")) {
      absl::StrAppend(&head, line, "\n");
    }
  }
  return head;
}

TEST(GatewayDoorTest, HeadAnswersAsGetDoesWithoutTheBody) {
  Gateway gateway({});
  for (const char* target : {"/",
                             "/index.html",
                             "/none",
                             "/healthz",
                             "/v1",
                             "/v1/none",
                             "/v1/datasets",
                             "/v1/datasets?x=1",
                             "/v1/datasets/d",
                             "/v1/datasets/e",
                             "/v1/datasets/d/none",
                             "/v1/datasets/d/histogram?bins=0",
                             "/v1/datasets/d/render",
                             "/v1/datasets/d/render?x=1",
                             "/v1/datasets/d/mesh.glb",
                             "/v1/datasets/d/mesh.glb?isovalue=x",
                             "/v1/interact",
                             "/v1/datasets/e/mesh.glb?isovalue=1",
                             "/..",
                             "/%00"}) {
    const std::string get = gateway.Ask(Get(target));
    RawConnection connection(gateway.port());
    connection.Send(absl::StrReplaceAll(Get(target), {{"GET ", "HEAD "}}) +
                    Get("/healthz", "Connection: close\r\n"));
    const std::string head = connection.ReadAnswer(/*is_of_head=*/true);
    EXPECT_EQ(HeadOf(head), HeadOf(get)) << target;
    EXPECT_THAT(connection.ReadAll(), AllOf(StartsWith("HTTP/1.1 200"), HasSubstr("ok\n")))
        << "no body: " << target;
  }
}

TEST(GatewayDoorTest, HeadOfAMeshHasTheStatusOfItsExportAndNoMore) {
  Gateway gateway({});
  constexpr char kTarget[] = "/v1/datasets/d/mesh.glb?isovalue=1";
  const std::string ask = absl::StrReplaceAll(Get(kTarget), {{"GET ", "HEAD "}});
  for (const auto& [code, status] :
       std::vector<std::pair<int, const char*>>{{grpc::StatusCode::NOT_FOUND, "404"},
                                                {grpc::StatusCode::INVALID_ARGUMENT, "400"},
                                                {grpc::StatusCode::FAILED_PRECONDITION, "409"},
                                                {grpc::StatusCode::RESOURCE_EXHAUSTED, "429"},
                                                {grpc::StatusCode::PERMISSION_DENIED, "403"}}) {
    gateway.surfaces.end = code;
    const std::string head = gateway.Ask(ask);
    EXPECT_THAT(head, StartsWith(absl::StrCat("HTTP/1.1 ", status)));
    EXPECT_EQ(HeadOf(head), HeadOf(gateway.Ask(Get(kTarget))));
  }
  gateway.surfaces.end = 0;
  EXPECT_THAT(gateway.Ask(ask), AllOf(StartsWith("HTTP/1.1 200"), HasSubstr("model/gltf-binary"),
                                      Not(HasSubstr("Content-Length"))))
      << "an empty mesh";
  // Signs of life are no piece: what comes after them counts.
  gateway.surfaces.pieces = 3;
  gateway.surfaces.has_vertices = false;
  gateway.surfaces.end = grpc::StatusCode::NOT_FOUND;
  EXPECT_THAT(gateway.Ask(ask), StartsWith("HTTP/1.1 404"));
  gateway.surfaces.has_vertices = true;
  gateway.surfaces.end = 0;
  // A mesh without end: the HEAD ends it with its first piece.
  gateway.surfaces.pieces = 1'000'000'000;
  EXPECT_THAT(gateway.Ask(ask), AllOf(StartsWith("HTTP/1.1 200"), HasSubstr("model/gltf-binary")));
}

}  // namespace
}  // namespace isoscope
