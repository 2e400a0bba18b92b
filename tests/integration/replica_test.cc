// Agents that serve the same shards, as real processes: one is lost at any step, hangs, or is
// replaced under load, and every frame is right. And frames that may lack shards.

#include <atomic>
#include <csignal>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "tests/support/process.h"
#include "tests/support/process_cluster.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::kPatience;
using ::testing::Not;
using testing::Render;
using testing::RunIsoscope;
using testing::ServerProcess;
using testing::SmallRequest;
using testing::StatusIs;
using RenderRequest = isoscope::v1::RenderIsosurfaceRequest;
using RenderResponse = absl::StatusOr<isoscope::v1::RenderIsosurfaceResponse>;

// With translucent layers in front: a fragment that is sent twice must count once there, too.
RenderRequest LayeredRequest() {
  RenderRequest request = SmallRequest();
  request.clear_isovalue();
  request.add_surfaces()->set_isovalue(140);
  for (const double isovalue : {128.0, 116.0}) {
    isoscope::v1::Surface* const surface = request.add_surfaces();
    surface->set_isovalue(isovalue);
    surface->mutable_color()->set_red(0.9F);
    surface->mutable_color()->set_green(0.7F);
    surface->mutable_color()->set_blue(0.4F);
    surface->mutable_color()->set_alpha(0.4F);
  }
  return request;
}

class ReplicaTest : public ::testing::Test {
 protected:
  static constexpr int kShardCount = 2;

  static void SetUpTestSuite() {
    directory_ = new testing::TempDir();
    ISOSCOPE_ASSERT_OK(
        testing::MakeDataset(testing::GyroidVolume({41, 35, 29}), Dataset(), kShardCount, 8));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster,
                                  testing::ProcessCluster::Start(Dataset(), kShardCount));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto response,
                                  Render(cluster->address(), LayeredRequest()));
    right_ = new isoscope::v1::RenderIsosurfaceResponse(response);
  }
  static void TearDownTestSuite() {
    delete right_;
    delete directory_;
  }

  static std::string Dataset() { return directory_->Sub("gyroid"); }
  static std::string Shard(int shard) {
    return testing::ShardDirectory(Dataset(), shard, kShardCount);
  }

  static void ExpectRight(const RenderResponse& response) {
    ISOSCOPE_ASSERT_OK(response);
    EXPECT_TRUE(response->png() == right_->png()) << "another picture";
    EXPECT_EQ(response->statistics().missing_shards_size(), 0);
    EXPECT_EQ(response->statistics().agents_size(), kShardCount);
    EXPECT_EQ(response->statistics().triangle_count(), right_->statistics().triangle_count());
    EXPECT_EQ(response->statistics().active_block_count(),
              right_->statistics().active_block_count());
  }

  inline static testing::TempDir* directory_ = nullptr;
  inline static isoscope::v1::RenderIsosurfaceResponse* right_ = nullptr;
};

// Shard 1 is served by two agents, each of which holds frames in one step. Which one a frame uses
// follows from ports, so the test finds it out.
class HeldReplicaTest : public ReplicaTest, public ::testing::WithParamInterface<const char*> {
 protected:
  void SetUp() override {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(agent_, testing::StartAgent({Shard(0)}));
    std::vector<std::string> addresses = {agent_.address};
    for (int i = 0; i < 2; ++i) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(upstreams_.emplace_back(), testing::StartAgent({Shard(1)}));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(
          holders_.emplace_back(),
          testing::StartHoldingAgent(upstreams_.back().address, GetParam()));
      addresses.push_back(holders_.back().address);
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(coordinator_, testing::StartCoordinator(addresses));
  }

  // Starts a frame; returns the agent that holds it, with the other one free to go on.
  testing::Process* HoldFrame(const RenderRequest& request, absl::Duration timeout) {
    frame_ = std::thread(
        [this, request, timeout] { response_ = Render(coordinator_.address, request, timeout); });
    for (const base::MonotonicTime limit = base::MonotonicNow() + kPatience;
         base::MonotonicNow() < limit;) {
      for (std::size_t i = 0; i < 2; ++i) {
        if (absl::StrContains(holders_[i].process->err(), "holding")) {
          holders_[1 - i].process->Signal(SIGUSR1);
          return holders_[i].process.get();
        }
      }
      absl::SleepFor(absl::Milliseconds(5));
    }
    ADD_FAILURE() << "no agent holds the frame";
    return holders_[0].process.get();
  }
  const RenderResponse& Answer() {
    frame_.join();
    return response_;
  }

  ServerProcess agent_;
  std::vector<ServerProcess> upstreams_;
  std::vector<ServerProcess> holders_;
  ServerProcess coordinator_;
  RenderResponse response_ = absl::UnknownError("no answer yet");
  std::thread frame_;
};

TEST_P(HeldReplicaTest, AnAgentThatIsKilledIsReplacedInTheFrameAndInTheNextOnes) {
  HoldFrame(LayeredRequest(), kPatience)->Kill();
  ExpectRight(Answer());
  for (int i = 0; i < 3; ++i) {
    ExpectRight(Render(coordinator_.address, LayeredRequest()));
  }
}

TEST_P(HeldReplicaTest, AnAgentThatHangsIsReplacedWithinTheDeadline) {
  HoldFrame(LayeredRequest(), absl::Seconds(20))->Stop();
  ExpectRight(Answer());
}

INSTANTIATE_TEST_SUITE_P(Steps, HeldReplicaTest,
                         ::testing::Values("begin", "occluders", "visible_blocks"),
                         [](const auto& step) { return std::string(step.param); });

// SIGTERM lets an agent announce that it drains: no part of a frame has to be repeated.
TEST_F(ReplicaTest, WhileOneOfTwoReplicasIsDrainedNoFrameFailsOnAnyAgent) {
  std::vector<ServerProcess> agents;
  for (int i = 0; i < 2; ++i) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(agents.emplace_back(), testing::StartAgent({Shard(0), Shard(1)}));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const ServerProcess coordinator,
      testing::StartCoordinator({agents[0].address, agents[1].address}, {"--poll-seconds", "0.1"}));
  std::atomic<bool> is_over{false};
  std::atomic<int> frame_count{0};
  std::vector<std::thread> clients;
  for (int client = 0; client < 2; ++client) {
    clients.emplace_back([&] {
      while (!is_over) {
        const RenderResponse response = Render(coordinator.address, LayeredRequest());
        ISOSCOPE_EXPECT_OK(response);
        EXPECT_TRUE(!response.ok() || response->png() == right_->png()) << "another picture";
        ++frame_count;
      }
    });
  }
  const auto wait_for_frames = [&](int count) {
    const int before = frame_count;
    const base::MonotonicTime limit = base::MonotonicNow() + kPatience;
    while (frame_count < before + count && base::MonotonicNow() < limit) {
      absl::SleepFor(absl::Milliseconds(5));
    }
  };
  wait_for_frames(4);
  agents[0].process->Signal(SIGTERM);
  ISOSCOPE_EXPECT_OK(coordinator.process->WaitForErrLine(
      absl::StrCat("agent_drains address=", agents[0].address)));
  ISOSCOPE_EXPECT_OK(agents[0].process->Wait(kPatience));
  wait_for_frames(4);
  is_over = true;
  for (std::thread& client : clients) {
    client.join();
  }
  EXPECT_THAT(coordinator.process->err(), Not(HasSubstr("agent_failed")));
}

TEST_F(ReplicaTest, AgentsAreReplacedOneAfterTheOtherUnderLoadAndNoFrameFails) {
  std::vector<ServerProcess> agents;
  std::vector<std::string> addresses;
  for (int i = 0; i < 4; ++i) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(agents.emplace_back(), testing::StartAgent({Shard(i / 2)}));
    addresses.push_back(agents.back().address);
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ServerProcess coordinator,
                                testing::StartCoordinator(addresses, {"--poll-seconds", "0.1"}));
  std::atomic<bool> is_over{false};
  std::atomic<int> frame_count{0};
  std::vector<std::thread> clients;
  for (int client = 0; client < 2; ++client) {
    clients.emplace_back([&] {
      while (!is_over) {
        ExpectRight(Render(coordinator.address, LayeredRequest()));
        ++frame_count;
      }
    });
  }
  const auto wait_for_frames = [&](int count) {
    const int before = frame_count;
    const base::MonotonicTime limit = base::MonotonicNow() + kPatience;
    while (frame_count < before + count && base::MonotonicNow() < limit) {
      absl::SleepFor(absl::Milliseconds(5));
    }
    EXPECT_GE(frame_count, before + count) << "frames do not go on";
  };
  const absl::Cleanup end_clients = [&] {
    is_over = true;
    for (std::thread& client : clients) {
      client.join();
    }
    EXPECT_GE(frame_count, 64);
  };
  for (int round = 0; round < 8 && !HasFailure(); ++round) {
    wait_for_frames(4);
    ServerProcess& agent = agents[static_cast<std::size_t>(round % 4)];
    if (round % 2 == 0) {
      agent.process->Kill();
    } else {
      agent.process->Signal(SIGTERM);  // drained: it ends its frames first
      ISOSCOPE_EXPECT_OK(agent.process->Wait(kPatience));
    }
    wait_for_frames(4);
    const std::string address = agent.address;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(agent, testing::StartAgent({Shard(round % 4 / 2)}, address));
    // Its twin may go once the coordinator has seen it.
    const base::MonotonicTime limit = base::MonotonicNow() + kPatience;
    std::string info;
    do {
      info = RunIsoscope({"info", "--server", coordinator.address}).out;
    } while (absl::StrContains(info, "unreachable") && base::MonotonicNow() < limit);
    EXPECT_THAT(info, ::testing::Not(HasSubstr("unreachable")));
  }
}

class PartialFrameTest : public ReplicaTest {
 protected:
  void SetUp() override {
    for (int shard = 0; shard < kShardCount; ++shard) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(agents_.emplace_back(), testing::StartAgent({Shard(shard)}));
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(holder_,
                                  testing::StartHoldingAgent(agents_[1].address, "visible_blocks"));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(coordinator_,
                                  testing::StartCoordinator({agents_[0].address, holder_.address}));
  }
  static RenderRequest PartialRequest() {
    RenderRequest request = LayeredRequest();
    request.set_allow_partial(true);
    return request;
  }

  std::vector<ServerProcess> agents_;
  ServerProcess holder_;  // in front of agent 1
  ServerProcess coordinator_;
};

TEST_F(PartialFrameTest, ShardsThatAreLostOnTheWayOrBeforeAreMissingInTheSamePicture) {
  RenderResponse first = absl::UnknownError("no answer yet");
  std::jthread frame([&] { first = Render(coordinator_.address, PartialRequest()); });
  ISOSCOPE_ASSERT_OK(holder_.process->WaitForErrLine("holding"));
  holder_.process->Kill();  // some of its pixels are in the picture already
  frame.join();
  ISOSCOPE_ASSERT_OK(first);
  const isoscope::v1::RenderStatistics& statistics = first->statistics();
  EXPECT_THAT(statistics.missing_shards(), ElementsAre(1));
  EXPECT_TRUE(statistics.has_active_block_coverage());
  EXPECT_DOUBLE_EQ(statistics.active_block_coverage(),
                   static_cast<double>(statistics.active_block_count()) /
                       static_cast<double>(right_->statistics().active_block_count()));
  EXPECT_GT(statistics.active_block_coverage(), 0.2);
  EXPECT_LT(statistics.active_block_coverage(), 0.8);
  EXPECT_FALSE(first->png() == right_->png());

  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto second, Render(coordinator_.address, PartialRequest()));
  EXPECT_TRUE(second.png() == first->png());
  EXPECT_THAT(second.statistics().missing_shards(), ElementsAre(1));

  RenderRequest with_planes = PartialRequest();
  with_planes.mutable_output()->set_normal(true);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto planes, Render(coordinator_.address, with_planes));
  EXPECT_TRUE(planes.png() == first->png());
  EXPECT_FALSE(planes.normal().empty());

  EXPECT_THAT(Render(coordinator_.address, LayeredRequest()),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("shard 1 of 2")));
}

TEST_F(PartialFrameTest, TheCommandLineWarnsAndTheReturnOfTheAgentMakesThePictureWhole) {
  holder_.process->Kill();
  const std::vector<std::string> arguments = {"render",
                                              "--server",
                                              coordinator_.address,
                                              "--isovalue",
                                              "128",
                                              "--width",
                                              "80",
                                              "--height",
                                              "60",
                                              "--output",
                                              directory_->Sub("p.png")};
  EXPECT_THAT(RunIsoscope(arguments).err, HasSubstr("shard 1"));
  std::vector<std::string> partial = arguments;
  partial.emplace_back("--allow-partial");
  const auto result = RunIsoscope(partial);
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(result.err, AllOf(HasSubstr("shard 1 is missing"), HasSubstr("% of the active")));
  partial.emplace_back("--quiet");
  EXPECT_THAT(RunIsoscope(partial).err, HasSubstr("shard 1 is missing")) << "never silently";
  // A partial picture has no record, because it can't be reproduced.
  const auto again = RunIsoscope({"render", "--server", coordinator_.address, "--like",
                                  directory_->Sub("p.png"), "--output", directory_->Sub("q.png")});
  EXPECT_NE(again.exit_code, 0);
  EXPECT_THAT(again.err, HasSubstr("no record"));

  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ServerProcess returned,
                                testing::StartAgent({Shard(1)}, holder_.address));
  const auto whole = Render(coordinator_.address, PartialRequest());
  // The first frame after the return may not know of it yet.
  ISOSCOPE_ASSERT_OK(whole);
  ExpectRight(Render(coordinator_.address, LayeredRequest()));
  ExpectRight(Render(coordinator_.address, PartialRequest()));
}

TEST_F(PartialFrameTest, WithoutAnyShardThereIsNoPicture) {
  holder_.process->Kill();
  agents_[0].process->Kill();
  const auto response = Render(coordinator_.address, PartialRequest());
  EXPECT_FALSE(response.ok());
  EXPECT_THAT(Render(coordinator_.address, PartialRequest()),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("shards 0, 1")));
}

}  // namespace
}  // namespace isoscope
