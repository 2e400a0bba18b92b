#include "client-cli/terminal/top_screen.h"

#include <algorithm>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/units.h"
#include "wire/proto_convert.h"

namespace isoscope::cli {
namespace {

namespace v1 = isoscope::v1;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

v1::AgentStatus* AddAgent(const std::string& address, ClusterSample* sample) {
  v1::AgentStatus* const agent = sample->status.add_agents();
  agent->set_address(address);
  agent->set_state(v1::AgentStatus::STATE_REACHABLE);
  for (const int index : {0, 1, 2, 5}) {
    v1::ServedShard* const shard = agent->add_shards();
    shard->set_dataset("head");
    shard->set_shard_index(index);
  }
  return agent;
}

// A cluster that has been up for `seconds` and has drawn 30 frames a second in that time.
ClusterSample SampleAt(int seconds) {
  ClusterSample sample;
  sample.date = absl::FromUnixSeconds(1'800'000'000 + seconds);
  v1::CoordinatorLoad* const load = sample.status.mutable_load();
  load->mutable_up_duration()->set_seconds(seconds);
  load->set_working_frame_count(2);
  load->set_queued_frame_count(5);
  load->set_done_frame_count(30 * seconds);
  load->set_network_bytes(base::kMiB * 8 * seconds);
  load->set_resident_bytes(300 * base::kMiB);
  load->set_memory_limit_bytes(2048 * base::kMiB);
  v1::AgentLoad* const agent = AddAgent("10.0.0.7:50052", &sample)->mutable_load();
  agent->mutable_up_duration()->set_seconds(seconds);
  agent->set_working_frame_count(2);
  agent->set_done_frame_count(30 * seconds);
  agent->set_triangle_count(45'000'000LL * seconds);
  agent->set_read_bytes(base::kMiB * 4 * seconds);
  *agent->mutable_busy_duration() = wire::ToProto(absl::Seconds(1.75 * seconds));
  agent->set_resident_bytes(512 * base::kMiB);
  agent->set_memory_limit_bytes(1024 * base::kMiB);
  return sample;
}

void AddFrame(const std::string& client, v1::FrameInWork::Step step, ClusterSample* sample) {
  v1::FrameInWork* const frame = sample->status.add_frames();
  frame->set_request_id("4bf92f3577b34da6a3ce929d0e0e4736");
  frame->set_client(client);
  frame->set_dataset("head");
  frame->mutable_extent()->set_width_px(1024);
  frame->mutable_extent()->set_height_px(768);
  frame->set_step(step);
  *frame->mutable_age_duration() = wire::ToProto(absl::Milliseconds(1250));
}

std::string TextOf(const ClusterSample& now, const std::optional<ClusterSample>& before,
                   const TopScreenOptions& options = {.server = "c:50051"}) {
  return absl::StrJoin(TopScreen(now, before, options), "\n");
}

TEST(TopScreenTest, RatesAreThoseBetweenTheTwoAnswers) {
  ClusterSample now = SampleAt(20);
  now.status.mutable_load()->set_done_frame_count(30 * 10 + 100);  // 100 in the last 10 s
  const std::string text = TextOf(now, SampleAt(10));
  EXPECT_THAT(text, AllOf(HasSubstr("frames: 2 in work, 5 waiting; 10.0/s done"),
                          HasSubstr("network 8.0 MiB/s"), HasSubstr("memory 300 of 2048 MiB")));
  EXPECT_THAT(text, AllOf(HasSubstr("10.0.0.7:50052  ok     head 0-2,5"), HasSubstr("30.0"),
                          HasSubstr("1.75"), HasSubstr("45.0 M"), HasSubstr("4.0 MiB"),
                          HasSubstr("512 of 1024 MiB")));
}

TEST(TopScreenTest, TheFirstTableHasRatesSinceTheStart) {
  EXPECT_THAT(TextOf(SampleAt(40), std::nullopt), HasSubstr("30.0/s done"));
}

TEST(TopScreenTest, AProcessThatBeganAnewHasRatesSinceItsStart) {
  // Its counters fell; nothing may be negative.
  const std::string text = TextOf(SampleAt(2), SampleAt(1000));
  EXPECT_THAT(text, HasSubstr("30.0/s done"));
  EXPECT_THAT(text, Not(HasSubstr(" -")));
}

TEST(TopScreenTest, ALostAgentIsShownWithItsReason) {
  ClusterSample now = SampleAt(5);
  v1::AgentStatus* const lost = AddAgent("10.0.0.8:50052", &now);
  lost->set_state(v1::AgentStatus::STATE_UNREACHABLE);
  lost->set_message("connection refused");
  EXPECT_THAT(TextOf(now, std::nullopt), AllOf(HasSubstr("10.0.0.8:50052  lost"),
                                               HasSubstr("10.0.0.8:50052: connection refused")));
}

TEST(TopScreenTest, AnAgentThatOpensItsShardsAndOneWithDamageAreShownAsSuch) {
  ClusterSample now = SampleAt(5);
  v1::AgentStatus* const opening = AddAgent("10.0.0.8:50052", &now);
  opening->set_state(v1::AgentStatus::STATE_OPENING);
  opening->set_message("3 of 8 shards are open");
  v1::DamagedShard* const damage = AddAgent("10.0.0.9:50052", &now)->add_damaged_shards();
  damage->set_dataset("head");
  damage->set_shard_index(2);
  damage->set_message("blocks.bin: ends");
  const std::string text = TextOf(now, std::nullopt);
  EXPECT_THAT(text, AllOf(HasSubstr("10.0.0.8:50052  opening"),
                          HasSubstr("10.0.0.8:50052: 3 of 8 shards are open"),
                          HasSubstr("10.0.0.9:50052  damaged"),
                          HasSubstr("10.0.0.9:50052: shard 2 of head is damaged: blocks.bin")));
}

TEST(TopScreenTest, FramesHaveTheirClientStepAndAge) {
  ClusterSample now = SampleAt(5);
  AddFrame("ipv4:10.1.2.3:4444", v1::FrameInWork::STEP_OCCLUDER_RENDERING, &now);
  EXPECT_THAT(TextOf(now, std::nullopt),
              HasSubstr("4bf92f3577b34da6a3ce929d0e0e4736  ipv4:10.1.2.3:4444  head     1024x768  "
                        "2 occluders  1.2 s"));
}

TEST(TopScreenTest, NoLineIsWiderAndNoTableHigherThanTheTerminal) {
  ClusterSample now = SampleAt(100'000);
  for (int i = 0; i < 30; ++i) {
    AddFrame(absl::StrCat("ipv4:10.1.2.3:", 40000 + i), v1::FrameInWork::STEP_QUEUED, &now);
    AddAgent(absl::StrCat("a-rather-long-name-of-a-host-", i, ":50052"), &now);
  }
  for (const int width : {1, 10, 40, 80, 120, 300}) {
    for (const int height : {1, 5, 24, 50}) {
      const std::vector<std::string> lines =
          TopScreen(now, SampleAt(99'998), {.server = "c:1", .width = width, .height = height});
      EXPECT_LE(lines.size(), static_cast<std::size_t>(height));
      for (const std::string& line : lines) {
        EXPECT_LE(line.size(), static_cast<std::size_t>(width)) << line;
      }
    }
  }
}

TEST(TopScreenTest, FramesThatFindNoRoomAreCounted) {
  ClusterSample now = SampleAt(5);
  for (int i = 0; i < 50; ++i) {
    AddFrame("c", v1::FrameInWork::STEP_QUEUED, &now);
  }
  const std::vector<std::string> lines =
      TopScreen(now, std::nullopt, {.server = "c:1", .width = 120, .height = 20});
  EXPECT_EQ(lines.size(), 20u);
  // 3 lines of head, a gap, agents with titles, a gap, titles.
  const auto shown = std::count_if(lines.begin(), lines.end(), [](const std::string& line) {
    return absl::StartsWith(line, "4bf92");
  });
  EXPECT_EQ(lines.back(), absl::StrCat("and ", 50 - shown, " more"));
}

TEST(TopScreenTest, APeersTextCannotSteerTheTerminal) {
  ClusterSample now = SampleAt(5);
  AddFrame("\x1b[2Jevil\r\n\x9b", v1::FrameInWork::STEP_QUEUED, &now);
  AddAgent("\x1b]0;title\x07:1", &now)->set_message("\x1b[31m");
  for (const std::string& line : TopScreen(now, std::nullopt, {.server = "\x1b"})) {
    for (const char c : line) {
      EXPECT_TRUE(c >= 0x20 && c < 0x7f) << line;
    }
  }
}

TEST(TopScreenTest, AnOlderCoordinatorWithoutLoadIsSaidToBeOne) {
  ClusterSample now;
  AddAgent("a:1", &now);
  EXPECT_THAT(TextOf(now, std::nullopt),
              AllOf(HasSubstr("older than this program"), HasSubstr("a:1")));
}

}  // namespace
}  // namespace isoscope::cli
