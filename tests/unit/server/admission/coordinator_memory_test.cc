#include "server/admission/coordinator_memory.h"

#include <cstdio>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "core/base/units.h"
#include "tests/support/status_matchers.h"

namespace isoscope::server {
namespace {

using isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr std::size_t kMiB = std::size_t{1} << 20;

frame::FrameSpec SpecOf(int width, int height) {
  frame::FrameSpec spec;
  spec.viewport = {width, height};
  return spec;
}

TEST(CoordinatorMemoryTest, AFramesBytesGrowWithPixelsAndWhatIsAskedFor) {
  frame::FrameSpec spec = SpecOf(1024, 1024);
  const std::size_t png = FrameBytes(spec, Delivery::kWhole);
  EXPECT_EQ(png, 35 * kMiB);  // 26 + 8 bytes a pixel, and 1 MiB
  spec.output.depth = true;
  EXPECT_EQ(FrameBytes(spec, Delivery::kWhole), png + 8 * kMiB);
  EXPECT_EQ(FrameBytes(spec, Delivery::kParts), png + 4 * kMiB);
  spec.output = {.image_format = frame::ImageFormat::kNone, .surface_index = true};
  EXPECT_EQ(FrameBytes(spec, Delivery::kParts), 28 * kMiB);
  // The picture counts, not the viewport that it is a part of.
  spec.viewport = {65536, 65536};
  spec.region = view::Region{0, 0, 1024, 1024};
  EXPECT_EQ(FrameBytes(spec, Delivery::kParts), 28 * kMiB);
}

TEST(CoordinatorMemoryTest, SamplesAndMarginsCountAsTheyAreDrawn) {
  frame::FrameSpec spec = SpecOf(1024, 1024);
  spec.effects.samples_per_side = 2;
  // 4 times 26 bytes a pixel, the picture's image of 12, and 8 as before.
  EXPECT_EQ(FrameBytes(spec, Delivery::kWhole), (4 * 26 + 12 + 8 + 1) * kMiB);
  spec = SpecOf(4096, 4096);
  spec.region = view::Region{512, 512, 1024, 1024};
  spec.effects.silhouette = {.width_px = 14, .color = {}};
  EXPECT_EQ(FrameBytes(spec, Delivery::kWhole),
            std::size_t{1056} * 1056 * 26 + (12 + 8 + 1) * kMiB);
  spec = SpecOf(4096, 4096);
  spec.effects.samples_per_side = 4;
  EXPECT_THAT(
      CoordinatorMemory(256 * kMiB).CheckFits(spec, Delivery::kWhole),
      StatusIs(absl::StatusCode::kResourceExhausted,
               AllOf(HasSubstr("4096 x 4096 pixels of 16 samples"), HasSubstr("fewer samples"))));
}

TEST(CoordinatorMemoryTest, TheSmallestLimitTakesACommonFrame) {
  const CoordinatorMemory memory(CoordinatorMemory::kMinLimitBytes);
  ISOSCOPE_EXPECT_OK(memory.CheckFits(SpecOf(1024, 1024), Delivery::kWhole));
  EXPECT_GT(memory.unused_image_bytes(), std::size_t{0});
  EXPECT_LT(memory.unused_image_bytes() + memory.active_blocks_bytes(),
            CoordinatorMemory::kMinLimitBytes / 4);
}

TEST(CoordinatorMemoryTest, AFrameThatCanNeverFitIsRefusedAtOnceWithTheLimit) {
  CoordinatorMemory memory(256 * kMiB);
  base::Cancellation cancellation;
  for (const absl::Status& status :
       {memory.CheckFits(SpecOf(16384, 16384), Delivery::kWhole),
        memory.ReserveFrame(SpecOf(16384, 16384), Delivery::kWhole, cancellation).status()}) {
    EXPECT_THAT(status, StatusIs(absl::StatusCode::kResourceExhausted,
                                 AllOf(HasSubstr("16384 x 16384"), HasSubstr("256 MiB"),
                                       HasSubstr("8705 MiB"), HasSubstr("144 MiB"),
                                       HasSubstr("--memory-limit"))));
  }
}

// Symptom: a large picture is asked for region by region, and the limit that the refusal of its
// first one named was too small for the next, which has margins on both sides.
TEST(CoordinatorMemoryTest, TheLimitThatIsNamedIsEnoughWhereverTheRegionLies) {
  frame::FrameSpec spec = SpecOf(26489, 1200);
  spec.effects.silhouette = {.width_px = 16, .color = {}};
  spec.region = view::Region{0, 0, 8886, 1024};
  std::vector<int> asked;  // by the place of the region: what the agents need
  const auto agent_limit = [&](const frame::FrameSpec& of_agents) {
    asked.push_back(of_agents.region->x);
    return std::size_t{0};
  };
  const absl::Status refused = CoordinatorMemory(CoordinatorMemory::kMinLimitBytes, agent_limit)
                                   .CheckFits(spec, Delivery::kWhole);
  EXPECT_THAT(refused, StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("raise ")));
  EXPECT_THAT(asked, ::testing::ElementsAre((26489 - 8886) / 2));
  int named = 0;
  const std::string sentence(refused.message());
  ASSERT_EQ(std::sscanf(sentence.substr(sentence.find("--memory-limit to")).c_str(),
                        "--memory-limit to %dMiB", &named),
            1);
  for (const int x : {0, 8886, 2 * 8886}) {
    spec.region->x = x;
    ISOSCOPE_EXPECT_OK(CoordinatorMemory(static_cast<std::size_t>(named) * kMiB)
                           .CheckFits(spec, Delivery::kWhole));
  }
  spec.region = view::Region{8886, 88, 8886, 1024};  // with margins on all sides
  EXPECT_FALSE(CoordinatorMemory(static_cast<std::size_t>(named - 1) * kMiB)
                   .CheckFits(spec, Delivery::kWhole)
                   .ok());
}

TEST(CoordinatorMemoryTest, ATraceCountsAndTheSmallestLimitTakesOneOfACommonFrame) {
  const base::Cancellation never;
  CoordinatorMemory memory(CoordinatorMemory::kMinLimitBytes);
  EXPECT_GT(memory.max_trace_spans(), std::size_t{30'000});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto taken,
      memory.ReserveFrame(SpecOf(1024, 1024), Delivery::kWhole, never, memory.trace_bytes()));
  EXPECT_EQ(memory.frame_bytes(),
            FrameBytes(SpecOf(1024, 1024), Delivery::kWhole) + memory.trace_bytes());
  ISOSCOPE_EXPECT_OK(memory.CheckFits(SpecOf(1200, 1200), Delivery::kWhole));
  EXPECT_THAT(memory.CheckFits(SpecOf(1200, 1200), Delivery::kWhole, memory.trace_bytes()),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("or for no trace")));
}

TEST(CoordinatorMemoryTest, AFrameWaitsUntilAnotherIsDoneOrItsTimeIsUp) {
  CoordinatorMemory memory(96 * kMiB);  // 54 for frames: one of 1024 x 1024
  base::Cancellation none;
  std::optional<base::MemoryBudget::Reservation> first;
  {
    auto taken = memory.ReserveFrame(SpecOf(1024, 1024), Delivery::kWhole, none);
    ISOSCOPE_ASSERT_OK(taken);
    first.emplace(*std::move(taken));
  }
  base::Cancellation short_time(base::MonotonicNow() + absl::Milliseconds(30));
  EXPECT_THAT(memory.ReserveFrame(SpecOf(1024, 1024), Delivery::kWhole, short_time),
              StatusIs(absl::StatusCode::kDeadlineExceeded));
  std::thread waiting(
      [&] { ISOSCOPE_EXPECT_OK(memory.ReserveFrame(SpecOf(1024, 1024), Delivery::kWhole, none)); });
  first.reset();
  waiting.join();
}

TEST(CoordinatorMemoryTest, AnExportOfManyAgentsLeavesFramesTheirs) {
  const base::Cancellation never;
  const base::Cancellation soon(base::MonotonicNow() + absl::Seconds(5));
  CoordinatorMemory memory(base::kGiB);
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto mesh, memory.ReserveExport(80, never));
    EXPECT_LT(memory.export_bytes(), base::kGiB / 8) << "80 agents fit the share of exports";
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto mesh, memory.ReserveExport(800, never));
  EXPECT_EQ(memory.export_bytes(), base::kGiB / 8) << "all of the exports' share";
  EXPECT_EQ(memory.frame_bytes(), std::size_t{0});
  for (int i = 0; i < 4; ++i) {
    ISOSCOPE_EXPECT_OK(memory.ReserveFrame(SpecOf(2048, 2048), Delivery::kWhole, soon)) << i;
  }
}

TEST(CoordinatorMemoryTest, ExportsWaitForOneAnother) {
  const base::Cancellation never;
  CoordinatorMemory memory(CoordinatorMemory::kMinLimitBytes);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto first, memory.ReserveExport(8, never));
  EXPECT_EQ(first.bytes(), CoordinatorMemory::kExportAnswerBytes + 8 * base::kMiB);
  base::Cancellation short_time(base::MonotonicNow() + absl::Milliseconds(30));
  EXPECT_THAT(memory.ReserveExport(1, short_time), StatusIs(absl::StatusCode::kDeadlineExceeded));
  base::Cancellation cancelled;
  cancelled.Cancel();
  EXPECT_THAT(memory.ReserveExport(1, cancelled), StatusIs(absl::StatusCode::kCancelled));
  std::thread waiting([&] { ISOSCOPE_EXPECT_OK(memory.ReserveExport(80, never)); });
  first.ShrinkTo(0);
  waiting.join();
}

}  // namespace
}  // namespace isoscope::server
