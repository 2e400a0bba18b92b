// Real processes that ask who calls: certificates made by openssl, tokens, plaintext, and what each
// wrong one gets. Every refusal has its code and says what came or what to do.

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <fstream>
#include <memory>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <grpcpp/create_channel.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>
#include <openssl/sha.h>

#include "core/base/monotonic_time.h"
#include "core/io/file.h"
#include "isoscope/internal/v1/partition_agent_service.grpc.pb.h"
#include "isoscope/v1/cluster_service.grpc.pb.h"
#include "isoscope/v1/dataset_service.grpc.pb.h"
#include "isoscope/v1/interact_service.grpc.pb.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"
#include "rpc/health_probe.h"
#include "rpc/peer.h"
#include "tests/support/certificates.h"
#include "tests/support/process.h"
#include "tests/support/process_cluster.h"
#include "tests/support/raw_connection.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope {
namespace {

namespace v1 = isoscope::v1;
using ::testing::AllOf;
using testing::FlagsOf;
using ::testing::HasSubstr;
using testing::IsOk;
using testing::kPatience;
using ::testing::Not;
using testing::ServerProcess;
using testing::SmallRequest;
using testing::StatusIs;
using testing::TestAuthority;
using Flags = std::vector<std::string>;

Flags operator+(Flags left, const Flags& right) {
  left.insert(left.end(), right.begin(), right.end());
  return left;
}

std::string TokenEntry(const std::string& token, const std::string& datasets,
                       const std::string& more = "") {
  unsigned char digest[SHA256_DIGEST_LENGTH];
  SHA256(reinterpret_cast<const unsigned char*>(token.data()), token.size(), digest);
  return absl::StrCat(R"({"name": ")", token, R"(", "sha256": ")",
                      absl::BytesToHexString(
                          absl::string_view(reinterpret_cast<const char*>(digest), sizeof(digest))),
                      R"(", "datasets": [)", datasets, "]", more, "}");
}

// One way to call a server.
class Caller {
 public:
  explicit Caller(const std::string& address, const rpc::TransportFlags& transport = {},
                  std::string token = "")
      : token_(std::move(token)) {
    const absl::StatusOr<rpc::Dialing> dialing = rpc::MakeDialing(transport, "");
    EXPECT_THAT(dialing, IsOk());
    channel_ = rpc::MakeFreshChannel(address, *dialing);
  }
  Caller(std::shared_ptr<grpc::Channel> channel, std::string token)
      : token_(std::move(token)), channel_(std::move(channel)) {}

  template <typename Stub, typename Request, typename Response>
  absl::StatusOr<Response> Call(std::unique_ptr<Stub> stub,
                                grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&,
                                                             Response*),
                                const Request& request) const {
    grpc::ClientContext context;
    context.set_deadline(base::MonotonicNow() + kPatience);
    rpc::SendToken(token_, &context);
    Response response;
    const absl::Status status = rpc::ToAbslStatus(((*stub).*method)(&context, request, &response));
    return status.ok() ? absl::StatusOr<Response>(std::move(response)) : status;
  }
  [[nodiscard]] absl::StatusOr<v1::RenderIsosurfaceResponse> Render(const std::string& dataset,
                                                                    int side_px = 0) const {
    v1::RenderIsosurfaceRequest request = SmallRequest();
    request.set_dataset(dataset);
    if (side_px > 0) {
      request.mutable_viewport()->set_width_px(side_px);
    }
    return Call(v1::IsosurfaceService::NewStub(channel_),
                &v1::IsosurfaceService::Stub::RenderIsosurface, request);
  }
  [[nodiscard]] absl::StatusOr<v1::ListDatasetsResponse> List() const {
    return Call(v1::DatasetService::NewStub(channel_), &v1::DatasetService::Stub::ListDatasets,
                v1::ListDatasetsRequest());
  }
  // Calls any method with an empty message, or with `bytes`.
  [[nodiscard]] absl::Status CallRaw(const std::string& method, std::string bytes = "") const {
    grpc::GenericStub stub(channel_);
    grpc::ClientContext context;
    context.set_deadline(base::MonotonicNow() + kPatience);
    rpc::SendToken(token_, &context);
    const grpc::Slice slice(bytes);
    const grpc::ByteBuffer request(&slice, 1);
    grpc::ByteBuffer response;
    grpc::Status status;
    absl::Notification done;
    stub.UnaryCall(&context, method, grpc::StubOptions(), &request, &response,
                   [&](const grpc::Status& ended) {
                     status = ended;
                     done.Notify();
                   });
    done.WaitForNotification();
    return rpc::ToAbslStatus(status);
  }
  [[nodiscard]] const std::shared_ptr<grpc::Channel>& channel() const { return channel_; }

 private:
  const std::string token_;
  std::shared_ptr<grpc::Channel> channel_;
};

// Every method of every service in a file: "/isoscope.v1.DatasetService/GetDataset".
std::vector<std::string> MethodsOf(const google::protobuf::FileDescriptor* file) {
  std::vector<std::string> methods;
  for (int i = 0; i < file->service_count(); ++i) {
    for (int j = 0; j < file->service(i)->method_count(); ++j) {
      methods.push_back(absl::StrCat("/", file->service(i)->full_name(), "/",
                                     file->service(i)->method(j)->name()));
    }
  }
  return methods;
}

// Two datasets, an authority, and a cluster with TLS and tokens.
class SecurityTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    suite_ = new Suite();
    for (const char* name : {"gyroid", "ball"}) {
      ISOSCOPE_ASSERT_OK(testing::MakeDataset(name == std::string("ball")
                                                  ? testing::BallVolume({33, 29, 31}, 0.7)
                                                  : testing::GyroidVolume({41, 35, 29}),
                                              suite_->folder.Sub(name), 1, 8));
    }
    suite_->agent = authority().IssueRole("agent");
    suite_->coordinator = authority().IssueRole("coordinator");
    suite_->client = authority().IssueRole("client");
    suite_->only_ca = {.ca_file = authority().ca_file()};
  }
  static void TearDownTestSuite() { delete suite_; }

  struct Suite {
    testing::TempDir folder;
    TestAuthority authority;
    rpc::TransportFlags agent;
    rpc::TransportFlags coordinator;
    rpc::TransportFlags client;
    rpc::TransportFlags only_ca;  // of a caller without a certificate
  };
  static const TestAuthority& authority() { return suite_->authority; }
  static std::string Shard(const std::string& dataset) {
    return testing::ShardDirectory(suite_->folder.Sub(dataset), 0, 1);
  }
  static std::string TokensFile() { return suite_->folder.Sub("tokens.json"); }
  static void WriteTokens(const std::string& entries) {
    testing::ReplaceFile(TokensFile(), absl::StrCat(R"({"tokens": [)", entries, "]}"));
  }

  void StartAgent(const rpc::TransportFlags& transport, const Flags& more = {}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        agent_, testing::StartAgent({Shard("gyroid"), Shard("ball")}, "127.0.0.1:0",
                                    FlagsOf(transport) + more));
  }
  void StartCoordinator(const rpc::TransportFlags& transport, const Flags& more = {}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        coordinator_, testing::StartCoordinator({agent_.address}, FlagsOf(transport) + more));
  }
  void StartSecure(const Flags& more = {}) {
    ASSERT_NO_FATAL_FAILURE(StartAgent(suite_->agent));
    ASSERT_NO_FATAL_FAILURE(StartCoordinator(suite_->coordinator, more));
  }

  inline static Suite* suite_ = nullptr;
  ServerProcess agent_;
  ServerProcess coordinator_;
};

TEST_F(SecurityTest, ThePictureIsTheSameWithTlsAndWithout) {
  ASSERT_NO_FATAL_FAILURE(StartSecure());
  const auto secure = Caller(coordinator_.address, suite_->client).Render("gyroid");
  ISOSCOPE_ASSERT_OK(secure);
  ASSERT_NO_FATAL_FAILURE(StartAgent({}));
  ASSERT_NO_FATAL_FAILURE(StartCoordinator({}));
  const auto plain = Caller(coordinator_.address).Render("gyroid");
  ISOSCOPE_ASSERT_OK(plain);
  EXPECT_TRUE(secure->png() == plain->png());
}

TEST_F(SecurityTest, EveryPublicCallAsksWhoCalls) {
  WriteTokens(TokenEntry("known", R"("*")"));
  ASSERT_NO_FATAL_FAILURE(StartSecure({"--tokens", TokensFile()}));
  const Caller nobody(coordinator_.address, suite_->only_ca);
  const Caller stranger(coordinator_.address, suite_->only_ca, "unknown");
  const Caller agent(coordinator_.address, suite_->agent);
  int count = 0;
  for (const google::protobuf::FileDescriptor* file :
       {v1::RenderIsosurfaceRequest::descriptor()->file(),
        v1::InteractRequest::descriptor()->file(), v1::PickSurfaceRequest::descriptor()->file(),
        v1::GetDatasetRequest::descriptor()->file(),
        v1::GetCapabilitiesRequest::descriptor()->file()}) {
    for (const std::string& method : MethodsOf(file)) {
      ++count;
      EXPECT_THAT(nobody.CallRaw(method),
                  StatusIs(absl::StatusCode::kUnauthenticated, HasSubstr("--token-file")))
          << method;
      EXPECT_THAT(stranger.CallRaw(method),
                  StatusIs(absl::StatusCode::kUnauthenticated, HasSubstr("not known")))
          << method;
      EXPECT_THAT(agent.CallRaw(method),
                  StatusIs(absl::StatusCode::kPermissionDenied, HasSubstr("the role agent")))
          << method;
    }
  }
  EXPECT_GE(count, 9) << "is a service missing in this test?";
}

TEST_F(SecurityTest, AnAgentAcceptsOnlyCoordinators) {
  ASSERT_NO_FATAL_FAILURE(StartAgent(suite_->agent));
  const Caller client(agent_.address, suite_->client);
  const Caller coordinator(agent_.address, suite_->coordinator);
  for (const std::string& method :
       MethodsOf(isoscope::internal::v1::DescribeShardsRequest::descriptor()->file())) {
    EXPECT_THAT(client.CallRaw(method),
                StatusIs(absl::StatusCode::kPermissionDenied,
                         AllOf(HasSubstr("only a coordinator"), HasSubstr("the role client"))))
        << method;
    EXPECT_FALSE(absl::IsPermissionDenied(coordinator.CallRaw(method))) << method;
  }
  EXPECT_THAT(Caller(agent_.address, suite_->only_ca)
                  .CallRaw("/isoscope.internal.v1.PartitionAgentService/DescribeShards"),
              StatusIs(absl::StatusCode::kUnavailable));
  // Any certificate gives access to health.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const rpc::Dialing dialing, rpc::MakeDialing(suite_->client, ""));
  EXPECT_THAT(rpc::ProbeHealth(agent_.address, dialing, kPatience), IsOk());
}

TEST_F(SecurityTest, CertificatesOfOthersAndOldOnesAreRefused) {
  ASSERT_NO_FATAL_FAILURE(StartSecure());
  const TestAuthority other;
  // The client knows another authority than the server's.
  EXPECT_THAT(Caller(coordinator_.address, {.ca_file = other.ca_file()}).List(),
              StatusIs(absl::StatusCode::kUnavailable));
  // The server knows another authority than the client's.
  rpc::TransportFlags foreign = other.IssueRole("client");
  foreign.ca_file = authority().ca_file();
  EXPECT_THAT(Caller(coordinator_.address, foreign).List(),
              StatusIs(absl::StatusCode::kUnavailable));
  // Expired. Our own programs would not even start with it.
  const rpc::TransportFlags old = authority().Issue({.name = "old", .role = "client", .days = -1});
  EXPECT_THAT(rpc::MakeDialing(old, ""), StatusIs(absl::StatusCode::kFailedPrecondition));
  const auto read = [](const std::string& path) {
    std::ostringstream text;
    text << std::ifstream(path).rdbuf();
    return text.str();
  };
  const auto credentials =
      grpc::SslCredentials({read(old.ca_file), read(old.key_file), read(old.certificate_file)});
  EXPECT_THAT(Caller(grpc::CreateChannel(coordinator_.address, credentials), "").List(),
              StatusIs(absl::StatusCode::kUnavailable));
  EXPECT_THAT(Caller(coordinator_.address, suite_->client).List(), IsOk());
}

TEST_F(SecurityTest, TheNameInTheCertificateMustBeThatOfTheAddress) {
  const rpc::TransportFlags named =
      authority().Issue({.name = "named", .alternative_names = "DNS:agents.test", .role = "agent"});
  ASSERT_NO_FATAL_FAILURE(StartAgent(named));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      coordinator_, testing::StartCoordinator({agent_.address}, FlagsOf(suite_->coordinator),
                                              /*wait_until_ready=*/false));
  EXPECT_THAT(Caller(coordinator_.address, suite_->client).Render("gyroid"),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr(agent_.address)));
  // Told the name, the coordinator accepts it.
  ASSERT_NO_FATAL_FAILURE(
      StartCoordinator(suite_->coordinator, {"--tls-server-name", "agents.test"}));
  EXPECT_THAT(Caller(coordinator_.address, suite_->client).Render("gyroid"), IsOk());
}

// An agent in the wrong hands: it counts the calls that reach it.
class CountingAgent final : public isoscope::internal::v1::PartitionAgentService::Service {
 public:
  grpc::Status DescribeShards(
      grpc::ServerContext* /*context*/,
      const isoscope::internal::v1::DescribeShardsRequest* /*request*/,
      isoscope::internal::v1::DescribeShardsResponse* /*response*/) override {
    ++call_count;
    return grpc::Status::OK;
  }

  std::atomic<int> call_count{0};
};

// A client's certificate is signed by the authority and may bear the name that is dialled.
TEST_F(SecurityTest, ACoordinatorAsksNobodyWhoIsNoAgent) {
  const auto start = [](CountingAgent* agent, const rpc::TransportFlags& transport) {
    grpc::ServerBuilder builder;
    rpc::ConfigureServer(&builder);
    builder.RegisterService(agent);
    const auto credentials =
        rpc::MakeServerCredentials(transport, "", rpc::PeerCertificate::kRequired, "");
    EXPECT_THAT(credentials, IsOk());
    return rpc::StartServer(&builder, "127.0.0.1:0", credentials.value_or(nullptr));
  };
  for (const bool is_agent : {true, false}) {
    CountingAgent agent;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const rpc::RunningServer server,
                                  start(&agent, is_agent ? suite_->agent : suite_->client));
    const std::string address = absl::StrCat("127.0.0.1:", server.port);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(coordinator_,
                                  testing::StartCoordinator({address}, FlagsOf(suite_->coordinator),
                                                            /*wait_until_ready=*/false));
    const absl::Status status =
        Caller(coordinator_.address, suite_->client).Render("gyroid").status();
    EXPECT_FALSE(status.ok());
    EXPECT_EQ(agent.call_count > 0, is_agent);
    EXPECT_EQ(absl::StrContains(status.message(), "must have the role agent"), !is_agent) << status;
  }
}

TEST_F(SecurityTest, AgentsBehindAnAddressOfTheDnsHaveTheCertificateOfTheName) {
  // localhost resolves to 127.0.0.1, which is not in this certificate.
  const rpc::TransportFlags named =
      authority().Issue({.name = "named", .alternative_names = "DNS:localhost", .role = "agent"});
  ASSERT_NO_FATAL_FAILURE(StartAgent(named));
  const std::string port = agent_.address.substr(agent_.address.rfind(':'));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      coordinator_,
      testing::StartCoordinator({"dns:///localhost" + port}, FlagsOf(suite_->coordinator)));
  EXPECT_THAT(Caller(coordinator_.address, suite_->client).Render("gyroid"), IsOk());
}

TEST_F(SecurityTest, PlaintextAndTlsDoNotMix) {
  ASSERT_NO_FATAL_FAILURE(StartSecure());
  EXPECT_THAT(Caller(coordinator_.address).List(), StatusIs(absl::StatusCode::kUnavailable));
  EXPECT_THAT(Caller(agent_.address).CallRaw("/grpc.health.v1.Health/Check"),
              StatusIs(absl::StatusCode::kUnavailable));
  ASSERT_NO_FATAL_FAILURE(StartAgent({}));
  EXPECT_THAT(Caller(agent_.address, suite_->coordinator).CallRaw("/grpc.health.v1.Health/Check"),
              StatusIs(absl::StatusCode::kUnavailable));
}

TEST_F(SecurityTest, PlaintextBeyondThisMachineIsWrongUsage) {
  const auto run = [](const Flags& argv) { return testing::RunCommand(argv, {}); };
  const std::string agent = ISOSCOPE_TEST_AGENT;
  const std::string coordinator = ISOSCOPE_TEST_COORDINATOR;
  const std::string gateway = ISOSCOPE_TEST_GATEWAY;
  const std::string isoscope = ISOSCOPE_TEST_PROGRAM;
  const std::string dataset = suite_->folder.Sub("ball");
  for (const Flags& argv :
       std::vector<Flags>{{agent, dataset, "--listen", "0.0.0.0:0"},
                          {coordinator, "--agent", "127.0.0.1:1", "--listen", "0.0.0.0:0"},
                          {coordinator, "--agent", "192.0.2.1:1", "--listen", "127.0.0.1:0"},
                          {coordinator, "--agent", "dns:///agents:1", "--listen", "127.0.0.1:0"},
                          {gateway, "--listen", "0.0.0.0:0"},
                          {gateway, "--server", "192.0.2.1:1", "--listen", "127.0.0.1:0"},
                          Flags{gateway, "--http", "--listen", "0.0.0.0:0"} +
                              FlagsOf(authority().IssueRole("gateway")),
                          {isoscope, "serve", dataset, "--listen", "0.0.0.0:0"},
                          {isoscope, "view", dataset, "--listen", "0.0.0.0:0", "--no-open"}}) {
    const testing::CommandResult result = run(argv);
    EXPECT_EQ(result.exit_code, 2) << argv[0] << " " << argv[1] << ": " << result.err;
    EXPECT_THAT(result.err, AllOf(HasSubstr("plaintext"), HasSubstr("--insecure")));
  }
}

TEST_F(SecurityTest, InsecureIsAllowedWhenSaidAndLogged) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(agent_,
                                testing::StartAgent({Shard("ball")}, "0.0.0.0:0", {"--insecure"}));
  EXPECT_THAT(agent_.process->err(), HasSubstr("warning insecure"));
  const std::string port = agent_.address.substr(agent_.address.rfind(':'));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(coordinator_, testing::StartCoordinator({"127.0.0.1" + port}));
  EXPECT_THAT(Caller(coordinator_.address).Render("ball"), IsOk());
  EXPECT_THAT(coordinator_.process->err(), Not(HasSubstr("insecure")));
}

TEST_F(SecurityTest, ProgramsDoNotStartWithCertificatesOfOtherRoles) {
  const std::string dataset = suite_->folder.Sub("ball");
  for (const Flags& argv : std::vector<Flags>{
           Flags{ISOSCOPE_TEST_AGENT, dataset, "--listen", "127.0.0.1:0"} + FlagsOf(suite_->client),
           Flags{ISOSCOPE_TEST_COORDINATOR, "--agent", "127.0.0.1:1", "--listen", "127.0.0.1:0"} +
               FlagsOf(suite_->agent),
           Flags{ISOSCOPE_TEST_GATEWAY, "--listen", "127.0.0.1:0"} + FlagsOf(suite_->client)}) {
    const testing::CommandResult result = testing::RunCommand(argv, {});
    EXPECT_EQ(result.exit_code, 1) << argv[0];
    EXPECT_THAT(result.err, HasSubstr("URI:isoscope:role:"));
  }
}

TEST_F(SecurityTest, TokensSeeTheirDatasetsOnlyOverTlsAndWithout) {
  WriteTokens(absl::StrCat(TokenEntry("all", R"("*")"), ",", TokenEntry("balls", R"("ball")")));
  for (const bool has_tls : {true, false}) {
    ASSERT_NO_FATAL_FAILURE(StartAgent(has_tls ? suite_->agent : rpc::TransportFlags()));
    ASSERT_NO_FATAL_FAILURE(StartCoordinator(has_tls ? suite_->coordinator : rpc::TransportFlags(),
                                             {"--tokens", TokensFile()}));
    const rpc::TransportFlags transport = has_tls ? suite_->only_ca : rpc::TransportFlags();
    const Caller all(coordinator_.address, transport, "all");
    const Caller balls(coordinator_.address, transport, "balls");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto seen_by_all, all.List());
    EXPECT_EQ(seen_by_all.datasets_size(), 2);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto seen, balls.List());
    ASSERT_EQ(seen.datasets_size(), 1);
    EXPECT_EQ(seen.datasets(0).name(), "ball");
    EXPECT_THAT(all.Render("gyroid"), IsOk());
    EXPECT_THAT(balls.Render("ball"), IsOk());
    EXPECT_THAT(balls.Render(""), IsOk()) << "the only one that it sees";
    // As if it were not there, in every call that names one.
    const auto is_hidden = StatusIs(absl::StatusCode::kNotFound,
                                    AllOf(HasSubstr("there are: \"ball\""), Not(HasSubstr("127"))));
    EXPECT_THAT(balls.Render("gyroid"), is_hidden);
    v1::GetDatasetRequest get;
    get.set_name("gyroid");
    EXPECT_THAT(balls.Call(v1::DatasetService::NewStub(balls.channel()),
                           &v1::DatasetService::Stub::GetDataset, get),
                is_hidden);
    v1::GetHistogramRequest histogram;
    histogram.set_dataset("gyroid");
    EXPECT_THAT(balls.Call(v1::DatasetService::NewStub(balls.channel()),
                           &v1::DatasetService::Stub::GetHistogram, histogram),
                is_hidden);
    v1::PickSurfaceRequest pick;
    *pick.mutable_frame() = SmallRequest();
    pick.mutable_frame()->set_dataset("gyroid");
    pick.add_pixels();
    EXPECT_THAT(balls.Call(v1::IsosurfaceService::NewStub(balls.channel()),
                           &v1::IsosurfaceService::Stub::PickSurface, pick),
                is_hidden);
    v1::ExportIsosurfaceRequest exported;
    exported.set_dataset("gyroid");
    exported.set_isovalue(128);
    EXPECT_THAT(balls.CallRaw("/isoscope.v1.IsosurfaceService/ExportIsosurface",
                              exported.SerializeAsString()),
                is_hidden);
    v1::RenderIsosurfaceStreamRequest stream;
    *stream.mutable_request() = pick.frame();
    EXPECT_THAT(balls.CallRaw("/isoscope.v1.IsosurfaceService/RenderIsosurfaceStream",
                              stream.SerializeAsString()),
                is_hidden);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto cluster,
        balls.Call(v1::ClusterService::NewStub(balls.channel()),
                   &v1::ClusterService::Stub::GetClusterStatus, v1::GetClusterStatusRequest()));
    EXPECT_THAT(cluster.DebugString(), Not(HasSubstr("gyroid")));
  }
}

TEST_F(SecurityTest, AnInteractiveStreamHasTheRightsOfItsToken) {
  WriteTokens(TokenEntry("balls", R"("ball")"));
  ASSERT_NO_FATAL_FAILURE(StartSecure({"--tokens", TokensFile()}));
  const Caller balls(coordinator_.address, suite_->only_ca, "balls");
  const auto stub = v1::InteractService::NewStub(balls.channel());
  grpc::ClientContext context;
  context.set_deadline(base::MonotonicNow() + kPatience);
  rpc::SendToken("balls", &context);
  const auto stream = stub->Interact(&context);
  const auto ask = [&](std::int64_t sequence, const std::string& dataset) {
    v1::InteractRequest request;
    request.mutable_view_state()->set_sequence_number(sequence);
    request.mutable_view_state()->set_is_at_rest(true);
    *request.mutable_view_state()->mutable_frame() = SmallRequest();
    request.mutable_view_state()->mutable_frame()->set_dataset(dataset);
    stream->Write(request);
  };
  v1::InteractResponse response;
  ask(1, "gyroid");
  ASSERT_TRUE(stream->Read(&response));
  EXPECT_EQ(response.error().code(), static_cast<int>(absl::StatusCode::kNotFound))
      << response.error().message();
  ask(2, "ball");
  do {
    ASSERT_TRUE(stream->Read(&response));
  } while (!response.is_exact());
  // The token is withdrawn while the stream is open.
  WriteTokens(TokenEntry("other", R"("*")"));
  std::int64_t sequence = 3;
  absl::Status status;
  const base::MonotonicTime limit = base::MonotonicNow() + kPatience;
  std::thread reader([&] {
    while (stream->Read(&response)) {
    }
    status = rpc::ToAbslStatus(stream->Finish());
  });
  absl::SleepFor(absl::Seconds(1));
  while (base::MonotonicNow() < limit && [&] {
    v1::InteractRequest request;
    request.mutable_view_state()->set_sequence_number(sequence++);
    *request.mutable_view_state()->mutable_frame() = SmallRequest();
    request.mutable_view_state()->mutable_frame()->set_dataset("ball");
    return stream->Write(request);
  }()) {
    absl::SleepFor(absl::Milliseconds(100));
  }
  reader.join();
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kUnauthenticated, HasSubstr("withdrawn")));
}

TEST_F(SecurityTest, LimitsOfATokenHaveTheirCodes) {
  WriteTokens(
      TokenEntry("small", R"("*")", R"(, "max_viewport_px": 100, "max_frames_per_second": 0.001)"));
  ASSERT_NO_FATAL_FAILURE(StartSecure({"--tokens", TokensFile()}));
  const Caller small(coordinator_.address, suite_->only_ca, "small");
  EXPECT_THAT(small.Render("ball", 101), StatusIs(absl::StatusCode::kPermissionDenied,
                                                  HasSubstr("at most 100 pixels a side")));
  EXPECT_THAT(small.Render("ball"), IsOk());
  EXPECT_THAT(small.Render("ball"), IsOk());
  EXPECT_THAT(small.Render("ball"),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("retry in")));
  EXPECT_THAT(small.List(), IsOk()) << "only frames are counted";
  EXPECT_THAT(Caller(coordinator_.address, suite_->client).Render("ball"), IsOk())
      << "the limits are the token's";
}

TEST_F(SecurityTest, NewCertificatesAreReadWhileOldConnectionsGoOn) {
  const rpc::TransportFlags first = authority().Issue({.name = "renewed", .role = "coordinator"});
  ASSERT_NO_FATAL_FAILURE(StartAgent(suite_->agent));
  ASSERT_NO_FATAL_FAILURE(StartCoordinator(first));
  const Caller before(coordinator_.address, suite_->client);
  ISOSCOPE_ASSERT_OK(before.List());
  // In place of the old one comes a certificate of another name.
  authority().Issue(
      {.name = "renewed", .alternative_names = "DNS:new.test", .role = "coordinator"});
  rpc::TransportFlags by_name = suite_->client;
  by_name.server_name = "new.test";
  const base::MonotonicTime limit = base::MonotonicNow() + kPatience;
  absl::Status after;
  do {
    after = Caller(coordinator_.address, by_name).List().status();
  } while (!after.ok() && base::MonotonicNow() < limit);
  EXPECT_THAT(after, IsOk()) << "the new certificate is never shown";
  EXPECT_THAT(before.List(), IsOk()) << "an old connection was cut";
  EXPECT_THAT(Caller(coordinator_.address, suite_->client).List(),
              StatusIs(absl::StatusCode::kUnavailable));
  EXPECT_THAT(before.Render("ball"), IsOk()) << "agents know the coordinator by its role";
}

TEST_F(SecurityTest, ProbesTellWhetherAServerServes) {
  ASSERT_NO_FATAL_FAILURE(StartSecure());
  const auto probe = [](const std::string& program, const Flags& flags) {
    return testing::RunCommand(Flags{program} + flags, {});
  };
  testing::CommandResult result =
      probe(ISOSCOPE_TEST_COORDINATOR,
            Flags{"--probe", "--listen", coordinator_.address} + FlagsOf(suite_->coordinator));
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(result.out, coordinator_.address + ": serving\n");
  result = probe(ISOSCOPE_TEST_AGENT, Flags{"--probe=" + agent_.address} + FlagsOf(suite_->agent));
  EXPECT_EQ(result.exit_code, 0) << result.out << result.err;
  result = probe(ISOSCOPE_TEST_AGENT, {"--probe=" + agent_.address});
  EXPECT_EQ(result.exit_code, 1) << "plaintext to TLS";
  EXPECT_THAT(result.out, HasSubstr("not serving: "));
  agent_.process->Kill();
  result = probe(ISOSCOPE_TEST_AGENT, Flags{"--probe=" + agent_.address} + FlagsOf(suite_->agent));
  EXPECT_EQ(result.exit_code, 1);
}

TEST_F(SecurityTest, TheCommandLineSendsItsTokenAndKeepsItOffPlaintext) {
  WriteTokens(TokenEntry("balls", R"("ball")"));
  ASSERT_NO_FATAL_FAILURE(StartSecure({"--tokens", TokensFile()}));
  const Flags info = {"info", "--server", coordinator_.address, "--tls-ca", authority().ca_file()};
  testing::CommandResult result = testing::RunIsoscope(info);
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.err, HasSubstr("UNAUTHENTICATED"));
  result = testing::RunIsoscope(info, {.environment = {"ISOSCOPE_TOKEN=balls"}});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(result.out, AllOf(HasSubstr("ball"), Not(HasSubstr("gyroid"))));
  const std::string file = suite_->folder.Sub("token");
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(file, "balls\n"));
  result = testing::RunIsoscope(info + Flags{"--token-file", file});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  result = testing::RunIsoscope(info + FlagsOf({.certificate_file = suite_->client.certificate_file,
                                                .key_file = suite_->client.key_file}));
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("gyroid"));

  result = testing::RunIsoscope({"info", "--server", "192.0.2.1:1", "--token-file", file});
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_THAT(result.err, AllOf(HasSubstr("plaintext"), Not(HasSubstr("balls"))));
  result = testing::RunIsoscope({"info", "--server", "127.0.0.1:1"},
                                {.environment = {"ISOSCOPE_TOKEN=a b"}});
  EXPECT_THAT(result.err, AllOf(HasSubstr("$ISOSCOPE_TOKEN"), Not(HasSubstr("a b"))));
}

TEST_F(SecurityTest, WhatAPeerSendsHasLimits) {
  ASSERT_NO_FATAL_FAILURE(StartAgent({}));
  ASSERT_NO_FATAL_FAILURE(StartCoordinator({}));
  const Caller caller(coordinator_.address);
  EXPECT_THAT(caller.CallRaw("/isoscope.v1.IsosurfaceService/RenderIsosurface",
                             std::string(std::size_t{2} << 20U, '\0')),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("larger than max")));
  // Metadata of 64 KiB.
  const auto stub = v1::DatasetService::NewStub(caller.channel());
  grpc::ClientContext context;
  context.set_deadline(base::MonotonicNow() + kPatience);
  context.AddMetadata("x-large", std::string(std::size_t{64} << 10U, 'x'));
  v1::ListDatasetsResponse response;
  EXPECT_THAT(rpc::ToAbslStatus(stub->ListDatasets(&context, {}, &response)),
              StatusIs(absl::StatusCode::kResourceExhausted));
  // That connection may end; the next one serves.
  absl::Status rendered;
  const base::MonotonicTime deadline = base::MonotonicNow() + kPatience;
  do {
    rendered = caller.Render("ball").status();
  } while (absl::IsUnavailable(rendered) && base::MonotonicNow() < deadline);
  EXPECT_THAT(rendered, IsOk());
}

// Symptom: a call with a dataset name of 900 kB was a line of 900 kB in the log and in the audit,
// before anybody knew who called, and 1.8 MB for one that was let in.
TEST_F(SecurityTest, LongAndSteeringTextsOfCallersAreBoundedAndEscaped) {
  WriteTokens(TokenEntry("all", R"("*")"));
  ASSERT_NO_FATAL_FAILURE(StartAgent({}));
  const std::string audit = suite_->folder.Sub("audit.json");
  ASSERT_NO_FATAL_FAILURE(StartCoordinator({}, {"--tokens", TokensFile(), "--audit-log", audit}));
  const std::string evil = "\x1b[2Jforged\n\u202e\u2028level=info \"";
  for (const std::string& name : {std::string(900'000, 'x'), evil + std::string(900'000, 'y')}) {
    for (const char* token : {"", "all"}) {
      const Caller caller(coordinator_.address, {}, token);
      v1::GetDatasetRequest get;
      get.set_name(name);
      v1::GetHistogramRequest histogram;
      histogram.set_dataset(name);
      for (const absl::Status& status :
           {caller.Render(name).status(),
            caller
                .Call(v1::DatasetService::NewStub(caller.channel()),
                      &v1::DatasetService::Stub::GetDataset, get)
                .status(),
            caller
                .Call(v1::DatasetService::NewStub(caller.channel()),
                      &v1::DatasetService::Stub::GetHistogram, histogram)
                .status()}) {
        EXPECT_FALSE(status.ok());
        EXPECT_LT(status.message().size(), 1000U);
        EXPECT_THAT(std::string(status.message()),
                    AllOf(Not(HasSubstr("\x1b")), Not(HasSubstr("\n")), Not(HasSubstr("\u202e"))));
      }
    }
  }
  const std::string log = coordinator_.process->err();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string audited, io::ReadWholeFile(audit, 1 << 24));
  for (const std::string& text : {log, audited}) {
    EXPECT_THAT(text, HasSubstr("... (cut, 900000 bytes)"));
    EXPECT_THAT(text, HasSubstr("\\u001b[2Jforged\\n\\u202e\\u2028"));
    EXPECT_THAT(text, AllOf(Not(HasSubstr("\x1b")), Not(HasSubstr("\u202e"))));
    for (const absl::string_view line : absl::StrSplit(text, '\n')) {
      EXPECT_LT(line.size(), 1500U) << line.substr(0, 300);
    }
  }
}

// Connections that never begin HTTP/2: gRPC ends them after its time for a handshake.
TEST_F(SecurityTest, ConnectionsThatBeginNothingShutNobodyOutAndEnd) {
  testing::RaiseFileLimit();
  ASSERT_NO_FATAL_FAILURE(StartAgent({}));
  ASSERT_NO_FATAL_FAILURE(StartCoordinator({}));
  for (const std::string& address : {coordinator_.address, agent_.address}) {
    std::vector<testing::RawConnection> silent;
    for (int i = 0; i < 1500; ++i) {
      silent.emplace_back(testing::PortOf(address))
          .Send(i % 3 == 0   ? ""
                : i % 3 == 1 ? "PRI * HTTP/2.0\r\n\r\n"
                             : "GET / HTTP/1.1\r\n");
    }
    EXPECT_THAT(rpc::ProbeHealth(address, {}, kPatience), IsOk()) << address;
    EXPECT_THAT(Caller(coordinator_.address).Render("ball"), IsOk());
    for (testing::RawConnection& connection : silent) {
      connection.ReadAll();
    }
  }
}

TEST_F(SecurityTest, ADatasetIsFoundByNameAndNeverByPath) {
  ASSERT_NO_FATAL_FAILURE(StartAgent({}));
  ASSERT_NO_FATAL_FAILURE(StartCoordinator({}));
  const Caller caller(coordinator_.address);
  for (const std::string& name :
       {std::string("../ball"), std::string("./ball"), suite_->folder.Sub("ball"), Shard("ball"),
        std::string("ball/"), std::string("/etc/passwd"), std::string("ball\0", 5)}) {
    EXPECT_THAT(caller.Render(name), StatusIs(absl::StatusCode::kNotFound)) << name;
  }
}

TEST_F(SecurityTest, ReflectionCanBeSwitchedOff) {
  for (const std::string method :
       {"/grpc.reflection.v1.ServerReflection/ServerReflectionInfo",
        "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo"}) {
    ASSERT_NO_FATAL_FAILURE(StartAgent({}));
    EXPECT_THAT(Caller(agent_.address).CallRaw(method),
                Not(StatusIs(absl::StatusCode::kUnimplemented)));
    ASSERT_NO_FATAL_FAILURE(StartAgent({}, {"--reflection", "off"}));
    EXPECT_THAT(Caller(agent_.address).CallRaw(method), StatusIs(absl::StatusCode::kUnimplemented));
  }
}

}  // namespace
}  // namespace isoscope
