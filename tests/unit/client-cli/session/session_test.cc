#include "client-cli/session/session.h"

#include <cstddef>
#include <memory>
#include <sstream>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "client-cli/session/embedded_cluster.h"
#include "clients/cpp/connection/service_client.h"
#include "core/base/cancellation.h"
#include "core/cli/interrupt.h"
#include "core/partition/partitioner.h"
#include "isoscope/v1/cluster_service.pb.h"
#include "partition-agent/memory/agent_memory.h"
#include "tests/support/memory_source.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::cli {
namespace {

class SessionTest : public ::testing::Test {
 protected:
  void SetUp() override {
    volume::GridGeometry geometry;
    geometry.sample_dims = {9, 9, 9};
    std::string samples(9 * 9 * 9, '\0');
    samples[samples.size() / 2] = '\xff';
    const auto source =
        testing::MakeMemorySource(geometry, volume::ScalarType::kUint8, std::move(samples), "dot");
    partition::PartitionOptions options;
    options.output_directory = directory_.Sub("dataset");
    ISOSCOPE_ASSERT_OK(partition::Partition(*source, options, base::Cancellation()));
    flags_.input = options.output_directory;
    flags_.renderer = render::RendererKind::kCpu;
    context_.out = &out_;
    context_.err = &out_;
    context_.interrupt = &interrupt_;
  }

  absl::StatusOr<std::unique_ptr<Session>> Open() {
    return Session::Open(flags_, nullptr, std::nullopt, context_);
  }

  testing::TempDir directory_;
  SessionFlags flags_;
  std::ostringstream out_;
  Interrupt interrupt_;
  Context context_;
};

// Symptom: a frame in one process that hung had a limit of a year.
TEST_F(SessionTest, InOneProcessTheServersLimitHoldsWithoutTimeout) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto session, Open());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto capabilities,
                                session->client().GetCapabilities(client::kQuestionTimeout));
  EXPECT_EQ(capabilities.max_frame_seconds(),
            absl::ToDoubleSeconds(EmbeddedClusterOptions().max_frame_duration));
  EXPECT_EQ(session->frame_timeout(), EmbeddedClusterOptions().max_frame_duration);
  EXPECT_EQ(session->question_timeout(), client::kQuestionTimeout);
}

TEST_F(SessionTest, TimeoutRaisesTheLimitInOneProcess) {
  flags_.timeout = absl::Hours(2);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto session, Open());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto capabilities,
                                session->client().GetCapabilities(client::kQuestionTimeout));
  EXPECT_EQ(capabilities.max_frame_seconds(), 7200);
  EXPECT_EQ(session->frame_timeout(), absl::Hours(2));
  EXPECT_EQ(session->question_timeout(), absl::Hours(2));
  EXPECT_EQ(session->export_timeout(), absl::Hours(2));
}

TEST(EmbeddedClusterTest, SaysThatALimitHasNoRoomForAllThreads) {
  EmbeddedClusterOptions options;
  options.thread_count = 64;
  options.memory_limit_bytes = agent::AgentMemory::kMinLimitBytes;
  const int drawing = agent::AgentMemory::DrawingThreads(64, options.memory_limit_bytes);
  ASSERT_LT(drawing, 64);
  EXPECT_EQ(agent::AgentMemory::MakeArena(64, options.memory_limit_bytes)->max_concurrency(),
            drawing);
  EXPECT_EQ(
      DescribeFewerThreads(options),
      absl::StrCat(drawing, " threads draw in place of 64: the memory limit of 96 MiB has no ",
                   "room for more; raise --memory-limit, or give --threads ", drawing));
  // The advice is right.
  options.thread_count = drawing;
  EXPECT_EQ(DescribeFewerThreads(options), "");
  options.thread_count = 64;
  options.memory_limit_bytes = std::size_t{1} << 32;
  EXPECT_EQ(DescribeFewerThreads(options), "");
}

TEST_F(SessionTest, WithAServerThatKeepsNoLimitFramesEndAllTheSame) {
  flags_ = SessionFlags();
  flags_.server = "127.0.0.1:1";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto session, Open());
  EXPECT_EQ(session->frame_timeout(), client::kAnswerTimeout);
  EXPECT_LT(session->question_timeout(), client::kAnswerTimeout);
  EXPECT_EQ(session->export_timeout(), absl::InfiniteDuration())
      << "the silence of the server ends exports";
}

}  // namespace
}  // namespace isoscope::cli
