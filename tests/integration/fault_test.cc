// A cluster of real processes in which something dies, hangs, leaves or is told to stop. A frame is
// right or an error that names who is to blame; and when the fault is gone, frames are right again.

#include <csignal>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>

#include "core/base/monotonic_time.h"
#include "core/io/file.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"
#include "tests/support/enough_time.h"
#include "tests/support/process.h"
#include "tests/support/process_cluster.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope {
namespace {

using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::HasSubstr;
using testing::kPatience;
using testing::ProcessCluster;
using testing::Render;
using testing::ServerProcess;
using testing::SmallRequest;
using testing::StatusIs;
using RenderResponse = absl::StatusOr<isoscope::v1::RenderIsosurfaceResponse>;

// A frame on a thread of its own.
class BackgroundFrame {
 public:
  BackgroundFrame(const std::string& address, absl::Duration timeout)
      : thread_(
            [this, address, timeout] { response_ = Render(address, SmallRequest(), timeout); }) {}
  ~BackgroundFrame() {
    if (thread_.joinable()) {
      thread_.join();
    }
  }
  BackgroundFrame(const BackgroundFrame&) = delete;
  BackgroundFrame& operator=(const BackgroundFrame&) = delete;

  const RenderResponse& Get() {
    if (thread_.joinable()) {
      thread_.join();
    }
    return response_;
  }

 private:
  RenderResponse response_ = absl::UnknownError("no answer yet");
  std::thread thread_;
};

class FaultTest : public ::testing::Test {
 protected:
  static constexpr int kShardCount = 2;

  static void SetUpTestSuite() {
    directory_ = new testing::TempDir();
    ISOSCOPE_ASSERT_OK(
        testing::MakeDataset(testing::GyroidVolume({41, 35, 29}), Dataset(), kShardCount, 8));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster,
                                  ProcessCluster::Start(Dataset(), kShardCount));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto response, Render(cluster->address(), SmallRequest()));
    right_png_ = new std::string(response.png());
  }
  static void TearDownTestSuite() {
    delete right_png_;
    delete directory_;
  }

  static std::string Dataset() { return directory_->Sub("gyroid"); }
  static std::string Shard(int shard) {
    return testing::ShardDirectory(Dataset(), shard, kShardCount);
  }
  static void ExpectRight(const RenderResponse& response) {
    ISOSCOPE_ASSERT_OK(response.status());
    EXPECT_TRUE(response->png() == *right_png_) << "another picture";
  }

  inline static testing::TempDir* directory_ = nullptr;
  inline static std::string* right_png_ = nullptr;
};

// A cluster whose shard 1 is behind an agent that holds frames in one step.
class HeldFrameTest : public FaultTest {
 protected:
  void Start(const std::string& hold) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(agent_, testing::StartAgent({Shard(0)}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(upstream_, testing::StartAgent({Shard(1)}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(holding_, testing::StartHoldingAgent(upstream_.address, hold));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(coordinator_,
                                  testing::StartCoordinator({agent_.address, holding_.address}));
  }
  void WaitUntilHeld() const { ISOSCOPE_ASSERT_OK(holding_.process->WaitForErrLine("holding")); }

  ServerProcess agent_;
  ServerProcess upstream_;
  ServerProcess holding_;
  ServerProcess coordinator_;
};

class AgentLostInStepTest : public HeldFrameTest,
                            public ::testing::WithParamInterface<const char*> {};

TEST_P(AgentLostInStepTest, IsUnavailableNamingItAndTheNextFrameAfterItsReturnIsRight) {
  ASSERT_NO_FATAL_FAILURE(Start(GetParam()));
  BackgroundFrame frame(coordinator_.address, kPatience);
  ASSERT_NO_FATAL_FAILURE(WaitUntilHeld());
  holding_.process->Kill();
  EXPECT_THAT(frame.Get(), StatusIs(absl::StatusCode::kUnavailable,
                                    AllOf(HasSubstr(holding_.address), HasSubstr("shard 1"))));
  // Gone for good, so far: the next frame says so at once.
  EXPECT_THAT(Render(coordinator_.address, SmallRequest()),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       AllOf(HasSubstr("shard 1 of 2"), HasSubstr(holding_.address))));
  // A real agent takes its place on the same port.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ServerProcess returned,
                                testing::StartAgent({Shard(1)}, holding_.address));
  ExpectRight(Render(coordinator_.address, SmallRequest()));
}

INSTANTIATE_TEST_SUITE_P(Steps, AgentLostInStepTest,
                         ::testing::Values("begin", "occluders", "visible_blocks"),
                         [](const auto& step) {
                           const std::string name = step.param;
                           return name == "begin"       ? "OccluderSelection"
                                  : name == "occluders" ? "OccluderRendering"
                                                        : "VisibilityCulling";
                         });

TEST_F(HeldFrameTest, ClientThatGoesAwayStopsTheFrameOnEveryAgent) {
  ASSERT_NO_FATAL_FAILURE(Start("occluders"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto client,
      testing::StartIsoscope({"render", "--server", coordinator_.address, "--isovalue", "128",
                              "--view", "front", "--output", directory_->Sub("never.png")}));
  ASSERT_NO_FATAL_FAILURE(WaitUntilHeld());
  agent_.process->Signal(SIGUSR1);  // agents log cancelled frames as debug lines
  ISOSCOPE_ASSERT_OK(agent_.process->WaitForErrLine("log_level"));
  client->Kill();
  ISOSCOPE_EXPECT_OK(holding_.process->WaitForErrLine("cancelled"));
  ISOSCOPE_EXPECT_OK(agent_.process->WaitForErrLine("frame_cancelled"));
  ISOSCOPE_EXPECT_OK(coordinator_.process->WaitForErrLine("frame_cancelled"));
  EXPECT_THAT(coordinator_.process->err(), HasSubstr("CANCELLED"));
  holding_.process->Signal(SIGUSR1);
  ExpectRight(Render(coordinator_.address, SmallRequest()));
}

TEST_F(HeldFrameTest, InterruptedClientStopsTheFrameAndLeavesNoPicture) {
  ASSERT_NO_FATAL_FAILURE(Start("visible_blocks"));
  const std::string output = directory_->Sub("interrupted.png");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto client,
      testing::StartIsoscope({"render", "--server", coordinator_.address, "--isovalue", "128",
                              "--view", "front", "--output", output}));
  ASSERT_NO_FATAL_FAILURE(WaitUntilHeld());
  client->Signal(SIGINT);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const int exit_code, client->Wait(kPatience));
  EXPECT_EQ(exit_code, 130);
  EXPECT_THAT(client->err(), HasSubstr("CANCELLED"));
  ISOSCOPE_EXPECT_OK(holding_.process->WaitForErrLine("cancelled"));
  EXPECT_FALSE(io::PathExists(output));
}

TEST_F(HeldFrameTest, SigtermLetsTheCoordinatorFinishTheFrameInWork) {
  ASSERT_NO_FATAL_FAILURE(Start("occluders"));
  BackgroundFrame frame(coordinator_.address, kPatience);
  ASSERT_NO_FATAL_FAILURE(WaitUntilHeld());
  coordinator_.process->Signal(SIGTERM);
  ISOSCOPE_ASSERT_OK(coordinator_.process->WaitForErrLine("shutdown"));
  holding_.process->Signal(SIGUSR1);
  ExpectRight(frame.Get());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const int exit_code, coordinator_.process->Wait(kPatience));
  EXPECT_EQ(exit_code, 0) << coordinator_.process->err();
  EXPECT_THAT(Render(coordinator_.address, SmallRequest(), absl::Seconds(5)),
              StatusIs(absl::StatusCode::kUnavailable));
}

TEST_F(HeldFrameTest, SigtermLetsAnAgentFinishTheFrameInWork) {
  ASSERT_NO_FATAL_FAILURE(Start("occluders"));
  BackgroundFrame frame(coordinator_.address, kPatience);
  ASSERT_NO_FATAL_FAILURE(WaitUntilHeld());
  agent_.process->Signal(SIGTERM);
  ISOSCOPE_ASSERT_OK(agent_.process->WaitForErrLine("shutdown"));
  holding_.process->Signal(SIGUSR1);
  ExpectRight(frame.Get());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const int exit_code, agent_.process->Wait(kPatience));
  EXPECT_EQ(exit_code, 0) << agent_.process->err();
}

// gRPC's own words: the client's deadline passed before the answer of the server came, which ends a
// frame up to 200 ms before.
constexpr char kAnswerCameLate[] = "Deadline Exceeded";

TEST_F(FaultTest, AgentThatHangsIsDeadlineExceededNamingItAndFramesAreRightAfterwards) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster, ProcessCluster::Start(Dataset(), kShardCount));
  cluster->agent(1).Stop();
  // The other agent must have answered by then, on a machine under load, too.
  constexpr absl::Duration kDeadline = absl::Seconds(10);
  testing::WithEnoughTime(kDeadline, [&](absl::Duration /*limit*/) {
    const base::MonotonicTime start = base::MonotonicNow();
    const absl::Status status = Render(cluster->address(), SmallRequest(), kDeadline).status();
    // With room for a slow machine, but well below any other limit.
    EXPECT_LT(base::MonotonicNow() - start, 10 * kDeadline);
    if (status.message() == kAnswerCameLate) {
      return false;
    }
    EXPECT_THAT(status, StatusIs(absl::StatusCode::kDeadlineExceeded,
                                 AllOf(HasSubstr(cluster->agent_address(1)), HasSubstr("shard 1"),
                                       ::testing::Not(HasSubstr(cluster->agent_address(0))))));
    return true;
  });
  cluster->agent(1).Signal(SIGCONT);
  ExpectRight(Render(cluster->address(), SmallRequest()));
}

TEST_F(FaultTest, FrameLimitOfTheCoordinatorNamesTheAgentThatHangs) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto cluster,
      ProcessCluster::Start(Dataset(), kShardCount, {"--max-frame-seconds", "10"}));
  cluster->agent(0).Stop();
  EXPECT_THAT(Render(cluster->address(), SmallRequest()),
              StatusIs(absl::StatusCode::kDeadlineExceeded,
                       AllOf(HasSubstr(cluster->agent_address(0)), HasSubstr("shard 0"))));
  cluster->agent(0).Signal(SIGCONT);
  ExpectRight(Render(cluster->address(), SmallRequest()));
}

// Symptom: connections were given up after 50 ms, so that clients and coordinators of a machine
// under load, or far away, got UNAVAILABLE "tcp handshaker shutdown" from a server that was well.
TEST_F(FaultTest, ServerThatIsSlowToAcceptAConnectionIsNotGivenUp) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster, ProcessCluster::Start(Dataset(), kShardCount));
  cluster->coordinator().Stop();
  BackgroundFrame frame(cluster->address(), kPatience);
  absl::SleepFor(absl::Milliseconds(500));  // how slow it is, not a wait for anything
  cluster->coordinator().Signal(SIGCONT);
  ExpectRight(frame.Get());
}

// The command line with --timeout, as a person would wait.
TEST_F(FaultTest, TimeoutOfTheCommandLineEndsTheWait) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster, ProcessCluster::Start(Dataset(), kShardCount));
  cluster->agent(1).Stop();
  testing::WithEnoughTime(absl::Seconds(2), [&](absl::Duration /*limit*/) {
    const testing::CommandResult result =
        testing::RunIsoscope({"render", "--server", cluster->address(), "--isovalue", "128",
                              "--output", directory_->Sub("late.png"), "--timeout", "2"});
    EXPECT_EQ(result.exit_code, 1);
    EXPECT_FALSE(io::PathExists(directory_->Sub("late.png")));
    EXPECT_THAT(result.err, HasSubstr("DEADLINE_EXCEEDED"));
    if (absl::StrContains(result.err, absl::StrCat("DEADLINE_EXCEEDED: ", kAnswerCameLate))) {
      return false;
    }
    EXPECT_THAT(result.err, HasSubstr(cluster->agent_address(1)));
    return true;
  });
}

// Agents die and return at any moment of a stream of frames: each frame is right or says why not.
TEST_F(FaultTest, AgentKilledAgainAndAgainNeverGivesAWrongPicture) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster, ProcessCluster::Start(Dataset(), kShardCount));
  for (int round = 0; round < 6; ++round) {
    const int victim = round % kShardCount;
    std::vector<std::unique_ptr<BackgroundFrame>> frames;
    frames.reserve(3);
    for (int i = 0; i < 3; ++i) {
      frames.push_back(std::make_unique<BackgroundFrame>(cluster->address(), kPatience));
    }
    // Any moment is right: frames are about to begin, in work or done.
    absl::SleepFor(absl::Milliseconds(7 * round));
    cluster->agent(victim).Kill();
    for (const auto& frame : frames) {
      const RenderResponse& response = frame->Get();
      if (response.ok()) {
        ExpectRight(response);
      } else {
        EXPECT_THAT(response, AnyOf(StatusIs(absl::StatusCode::kUnavailable),
                                    StatusIs(absl::StatusCode::kFailedPrecondition)));
        EXPECT_THAT(std::string(response.status().message()),
                    AllOf(HasSubstr(cluster->agent_address(victim)),
                          HasSubstr(absl::StrCat("shard ", victim))));
      }
    }
    ISOSCOPE_ASSERT_OK(cluster->RestartAgent(victim));
    ExpectRight(Render(cluster->address(), SmallRequest()));
  }
}

TEST_F(FaultTest, TwoClientsAtOnceGetTheirOwnPictures) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster, ProcessCluster::Start(Dataset(), kShardCount));
  constexpr int kClientCount = 2;
  constexpr int kFrameCount = 20;
  const auto request_of = [](int client, int frame) {
    isoscope::v1::RenderIsosurfaceRequest request = SmallRequest();
    request.set_isovalue(100 + 15 * client + 5 * (frame % 4));
    return request;
  };
  std::vector<std::vector<std::string>> expected(kClientCount);
  for (int client = 0; client < kClientCount; ++client) {
    for (int frame = 0; frame < 4; ++frame) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto response,
                                    Render(cluster->address(), request_of(client, frame)));
      expected[static_cast<std::size_t>(client)].push_back(response.png());
    }
  }
  ASSERT_NE(expected[0][0], expected[1][0]);
  std::vector<std::thread> clients;
  clients.reserve(kClientCount);
  for (int client = 0; client < kClientCount; ++client) {
    clients.emplace_back([&, client] {
      for (int frame = 0; frame < kFrameCount; ++frame) {
        const RenderResponse response = Render(cluster->address(), request_of(client, frame));
        ISOSCOPE_EXPECT_OK(response);
        if (response.ok()) {
          EXPECT_TRUE(
              response->png() ==
              expected[static_cast<std::size_t>(client)][static_cast<std::size_t>(frame % 4)])
              << "client " << client << ", frame " << frame;
        }
      }
    });
  }
  for (std::thread& client : clients) {
    client.join();
  }
}

// More frames than may be in work and wait: some are refused with what to do, none is wrong.
TEST_F(HeldFrameTest, FramesBeyondTheQueueAreRefused) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(agent_, testing::StartAgent({Shard(0)}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(upstream_, testing::StartAgent({Shard(1)}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(holding_, testing::StartHoldingAgent(upstream_.address, "begin"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      coordinator_,
      testing::StartCoordinator({agent_.address, holding_.address},
                                {"--max-concurrent-frames", "1", "--max-queued-frames", "0"}));
  BackgroundFrame frame(coordinator_.address, kPatience);
  ASSERT_NO_FATAL_FAILURE(WaitUntilHeld());
  EXPECT_THAT(Render(coordinator_.address, SmallRequest()),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("retry")));
  holding_.process->Signal(SIGUSR1);
  ExpectRight(frame.Get());
}

grpc::ByteBuffer BufferOf(const std::string& bytes) {
  const grpc::Slice slice(bytes);
  return {&slice, 1};
}

std::string BytesOf(const grpc::ByteBuffer& buffer) {
  std::vector<grpc::Slice> slices;
  EXPECT_TRUE(buffer.Dump(&slices).ok());
  std::string bytes;
  for (const grpc::Slice& slice : slices) {
    bytes.append(reinterpret_cast<const char*>(slice.begin()), slice.size());
  }
  return bytes;
}

// A length-delimited field of fewer than 128 bytes.
std::string StringField(int number, const std::string& value) {
  return std::string{static_cast<char>(number << 3 | 2), static_cast<char>(value.size())} + value;
}

// One request and one answer of any method, unary or streaming, without its generated code (Debian
// ships none for health and reflection).
absl::StatusOr<std::string> CallByName(const std::string& address, const std::string& method,
                                       const std::string& request) {
  grpc::GenericStub stub(rpc::MakeFreshChannel(address));
  grpc::ClientContext context;
  context.set_deadline(base::MonotonicNow() + kPatience);
  grpc::CompletionQueue queue;
  const auto call = stub.PrepareCall(&context, method, &queue);
  void* tag = nullptr;
  bool ok = false;
  const auto wait = [&] { return queue.Next(&tag, &ok) && ok; };
  grpc::ByteBuffer answer;
  call->StartCall(nullptr);
  bool is_answered = wait();
  call->WriteLast(BufferOf(request), grpc::WriteOptions(), nullptr);
  is_answered = wait() && is_answered;
  call->Read(&answer, nullptr);
  is_answered = wait() && is_answered;
  grpc::Status status;
  call->Finish(&status, nullptr);
  wait();
  if (!status.ok()) {
    return rpc::ToAbslStatus(status);
  }
  return is_answered ? absl::StatusOr<std::string>(BytesOf(answer))
                     : absl::UnknownError("no answer");
}

absl::StatusOr<std::string> CheckHealth(const std::string& address, const std::string& service) {
  return CallByName(address, "/grpc.health.v1.Health/Check",
                    service.empty() ? "" : StringField(1, service));
}

TEST_F(FaultTest, HealthAndReflectionAnswer) {
  const std::string serving = "\x08\x01";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster, ProcessCluster::Start(Dataset(), kShardCount));
  for (const char* service : {"", "isoscope.v1.IsosurfaceService", "isoscope.v1.DatasetService",
                              "isoscope.v1.ClusterService"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string health,
                                  CheckHealth(cluster->address(), service));
    EXPECT_EQ(health, serving) << service;
  }
  EXPECT_THAT(CheckHealth(cluster->address(), "no.such.Service"),
              StatusIs(absl::StatusCode::kNotFound));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string agent_health,
                                CheckHealth(cluster->agent_address(0), ""));
  EXPECT_EQ(agent_health, serving);

  for (const auto& [address, service] :
       {std::pair<std::string, std::string>{cluster->address(), "isoscope.v1.IsosurfaceService"},
        {cluster->agent_address(0), "isoscope.internal.v1.PartitionAgentService"}}) {
    for (const char* version : {"v1", "v1alpha"}) {
      const std::string method =
          absl::StrCat("/grpc.reflection.", version, ".ServerReflection/ServerReflectionInfo");
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string services,
                                    CallByName(address, method, StringField(7, "*")));
      EXPECT_THAT(services, HasSubstr(service));
      EXPECT_THAT(services, HasSubstr("grpc.reflection.v1.ServerReflection"));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string file,
                                    CallByName(address, method, StringField(4, service)));
      EXPECT_THAT(file, HasSubstr("_service.proto")) << version;
    }
  }

  // A cluster that lacks a shard is ready: other datasets of it can be had, and calls say what
  // lacks.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const ServerProcess lonely,
      testing::StartCoordinator({cluster->agent_address(0)}, {}, /*wait_until_ready=*/false));
  ISOSCOPE_ASSERT_OK(lonely.process->WaitForErrLine("dataset_not_ready"));
  for (const char* service : {"", "isoscope.v1.IsosurfaceService"}) {
    const base::MonotonicTime end = base::MonotonicNow() + kPatience;
    std::string health;
    while (health != serving &&
           base::MonotonicNow() < end) {  // the line comes before the probe's end
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(health, CheckHealth(lonely.address, service));
    }
    EXPECT_EQ(health, serving) << service;
  }
}

TEST_F(FaultTest, ServersThatCanNotStartSayWhyAndExitWithOne) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ServerProcess agent, testing::StartAgent({Shard(0)}));
  EXPECT_THAT(testing::StartAgent({Shard(1)}, agent.address),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       AllOf(HasSubstr("ended with 1"), HasSubstr(agent.address))));
  EXPECT_THAT(testing::StartAgent({directory_->Sub("absent")}),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       AllOf(HasSubstr("ended with 1"), HasSubstr("absent"))));
  EXPECT_THAT(testing::StartAgent({Shard(0)}, "127.0.0.1:0", {"--no-such-flag"}),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       AllOf(HasSubstr("ended with 2"), HasSubstr("no-such-flag"))));
  EXPECT_THAT(testing::StartCoordinator({agent.address, agent.address}),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       AllOf(HasSubstr("ended with 1"), HasSubstr("given twice"))));
}

}  // namespace
}  // namespace isoscope
