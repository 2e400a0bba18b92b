#include "server/admission/coordinator_memory.h"

#include <algorithm>
#include <cstdio>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "core/base/units.h"
#include "core/frame/drawn_window.h"
#include "tests/support/status_matchers.h"

namespace isoscope::server {
namespace {

using isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr std::size_t kMiB = std::size_t{1} << 20;
constexpr FrameWish kAtOnce = {};
constexpr FrameWish kInBands = {.may_band = true};

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
  spec.output.depth_bounds = true;
  EXPECT_EQ(FrameBytes(spec, Delivery::kWhole), png + 24 * kMiB);
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
      CoordinatorMemory(256 * kMiB).CheckFits(spec, kAtOnce),
      StatusIs(absl::StatusCode::kResourceExhausted,
               AllOf(HasSubstr("4096 x 4096 pixels of 16 samples"), HasSubstr("fewer samples"))));
}

TEST(CoordinatorMemoryTest, TheSmallestLimitTakesACommonFrame) {
  const CoordinatorMemory memory(CoordinatorMemory::kMinLimitBytes);
  ISOSCOPE_EXPECT_OK(memory.CheckFits(SpecOf(1024, 1024), kAtOnce));
  EXPECT_GT(memory.unused_image_bytes(), std::size_t{0});
  EXPECT_LT(memory.unused_image_bytes() + memory.active_blocks_bytes(),
            CoordinatorMemory::kMinLimitBytes / 4);
}

TEST(CoordinatorMemoryTest, AFrameThatCanNeverFitIsRefusedAtOnceWithTheLimit) {
  CoordinatorMemory memory(256 * kMiB);
  base::Cancellation cancellation;
  for (const absl::Status& status :
       {memory.CheckFits(SpecOf(16384, 16384), kAtOnce),
        memory.ReserveFrame(SpecOf(16384, 16384), kAtOnce, cancellation).status()}) {
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
  const absl::Status refused =
      CoordinatorMemory(CoordinatorMemory::kMinLimitBytes, agent_limit).CheckFits(spec, kAtOnce);
  EXPECT_THAT(refused, StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("raise ")));
  EXPECT_THAT(asked, ::testing::Not(::testing::IsEmpty()));
  EXPECT_THAT(asked, ::testing::Each((26489 - 8886) / 2));
  int named = 0;
  const std::string sentence(refused.message());
  ASSERT_EQ(std::sscanf(sentence.substr(sentence.find("--memory-limit to")).c_str(),
                        "--memory-limit to %dMiB", &named),
            1);
  for (const int x : {0, 8886, 2 * 8886}) {
    spec.region->x = x;
    ISOSCOPE_EXPECT_OK(
        CoordinatorMemory(static_cast<std::size_t>(named) * kMiB).CheckFits(spec, kAtOnce));
  }
  spec.region = view::Region{8886, 88, 8886, 1024};  // with margins on all sides
  EXPECT_FALSE(
      CoordinatorMemory(static_cast<std::size_t>(named - 1) * kMiB).CheckFits(spec, kAtOnce).ok());
}

// Frames that are refused, or that are not, for all that can make them large.
std::vector<frame::FrameSpec> LargeFrames() {
  std::vector<frame::FrameSpec> specs;
  specs.push_back(SpecOf(3840, 2160));
  specs.back().effects.samples_per_side = 4;
  specs.push_back(SpecOf(1920, 1080));
  specs.back().effects.samples_per_side = 2;
  specs.back().surfaces.resize(2);
  specs.back().surfaces[1].opacity = 0.5F;
  specs.push_back(specs.back());
  specs.back().effects.ambient_occlusion = frame::AmbientOcclusion{.radius_px = 56};
  specs.back().output.depth = true;
  specs.push_back(SpecOf(16384, 100));
  specs.back().effects.samples_per_side = 2;
  specs.push_back(SpecOf(2500, 2500));
  specs.back().output.image_format = frame::ImageFormat::kJpeg;
  specs.push_back(SpecOf(20000, 20000));
  specs.back().region = view::Region{500, 600, 3000, 2000};
  specs.back().effects.silhouette.emplace();
  return specs;
}

std::size_t DrawnPixels(const frame::FrameSpec& spec) {
  const view::Viewport size = frame::DrawnWindowOf(spec).image_size();
  return static_cast<std::size_t>(size.width_px) * static_cast<std::size_t>(size.height_px);
}

int NamedLimitMib(const absl::Status& refused) {
  int named = 0;
  const std::string sentence(refused.message());
  EXPECT_EQ(std::sscanf(sentence.substr(sentence.find("--memory-limit to")).c_str(),
                        "--memory-limit to %dMiB", &named),
            1)
      << refused;
  return named;
}

TEST(CoordinatorMemoryTest, WhatFitsIsDrawnAtOnceAndOthersInBandsOfThreeQuartersOfWhatIsFree) {
  const base::Cancellation never;
  for (const int limit_mib : {96, 160, 512, 2048, 8192}) {
    CoordinatorMemory memory(static_cast<std::size_t>(limit_mib) * kMiB);
    const std::size_t capacity = static_cast<std::size_t>(limit_mib) * kMiB / 16 * 9;
    for (const frame::FrameSpec& spec : LargeFrames()) {
      SCOPED_TRACE(::testing::Message() << limit_mib << " MiB, " << spec.viewport.width_px << " x "
                                        << spec.viewport.height_px);
      const auto bands = memory.PlanFrame(spec, kInBands, {});
      if (memory.CheckFits(spec, kAtOnce).ok()) {
        ISOSCOPE_ASSERT_OK(bands);
        EXPECT_EQ(bands->count(), 1);
        continue;
      }
      if (!bands.ok()) {
        EXPECT_GT(NamedLimitMib(bands.status()), limit_mib);
        continue;
      }
      EXPECT_GT(bands->count(), 1);
      const BandedBytes bytes = BandedBytesOf(spec, bands->band(), Delivery::kWhole);
      EXPECT_LE(bytes.band, (capacity - bytes.kept) / 4 * 3);
      EXPECT_LE(bytes.most(), capacity);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto taken, memory.ReserveFrame(spec, kInBands, never));
      EXPECT_GE(memory.frame_bytes(), bytes.most());
      EXPECT_LE(memory.frame_bytes(), capacity);
    }
  }
}

// Symptom: samples of a 4K picture, and translucent surfaces, were refused, and larger pictures of
// the command line were not.
TEST(CoordinatorMemoryTest, CommonLimitsDrawWhatScreensAndPrintersAskFor) {
  const frame::FrameSpec print = SpecOf(7680, 4320);
  for (const std::size_t limit_mib : {std::size_t{512}, std::size_t{2048}, std::size_t{6144}}) {
    const CoordinatorMemory memory(limit_mib * kMiB);
    ISOSCOPE_EXPECT_OK(memory.CheckFits(print, kInBands)) << limit_mib;
    for (const frame::FrameSpec& spec : LargeFrames()) {
      ISOSCOPE_EXPECT_OK(memory.CheckFits(spec, kInBands)) << limit_mib;
    }
  }
}

// Symptom: a JPEG of 8K was refused where the PNG was drawn.
TEST(CoordinatorMemoryTest, AJpegThatIsEncodedByRowsKeepsItsBytesOnce) {
  frame::FrameSpec jpeg = SpecOf(7680, 4320);
  jpeg.effects.samples_per_side = 2;
  jpeg.surfaces.resize(2);
  jpeg.surfaces[1].opacity = 0.5F;
  jpeg.output.image_format = frame::ImageFormat::kJpeg;
  for (const std::uint8_t alpha : {std::uint8_t{255}, std::uint8_t{0}}) {
    jpeg.background_color.a = alpha;
    EXPECT_TRUE(IsEncodedByRows(jpeg));
    ISOSCOPE_EXPECT_OK(CoordinatorMemory(512 * kMiB).CheckFits(jpeg, kInBands));
    const BandedBytes bytes = BandedBytesOf(jpeg, {7680, 64}, Delivery::kParts);
    EXPECT_EQ(bytes.encode, bytes.kept);
    EXPECT_EQ(bytes.send, bytes.kept);
  }
  frame::FrameSpec png = jpeg;
  png.output.image_format = frame::ImageFormat::kPng;
  EXPECT_FALSE(IsEncodedByRows(png)) << "over a clear background the last pixel may be translucent";
}

TEST(CoordinatorMemoryTest, TheLimitThatIsNamedForBandsIsTheLeastThatDraws) {
  for (const bool has_trace : {false, true}) {
    for (const Delivery delivery : {Delivery::kWhole, Delivery::kParts}) {
      for (frame::FrameSpec spec : LargeFrames()) {
        spec.output.position = true;
        spec.output.normal = true;
        const FrameWish wish{.delivery = delivery, .has_trace = has_trace, .may_band = true};
        const auto agent_limit = [](const frame::FrameSpec& of_agents) {
          return std::max(CoordinatorMemory::kMinLimitBytes, DrawnPixels(of_agents) * 256);
        };
        const absl::Status refused =
            CoordinatorMemory(CoordinatorMemory::kMinLimitBytes, agent_limit).CheckFits(spec, wish);
        if (refused.ok()) {
          continue;
        }
        EXPECT_THAT(refused, StatusIs(absl::StatusCode::kResourceExhausted,
                                      AllOf(HasSubstr("also in bands"), HasSubstr("planes"))));
        const auto named = static_cast<std::size_t>(NamedLimitMib(refused));
        ISOSCOPE_EXPECT_OK(CoordinatorMemory(named * kMiB, agent_limit).CheckFits(spec, wish));
        EXPECT_FALSE(CoordinatorMemory((named - 1) * kMiB, agent_limit).CheckFits(spec, wish).ok());
      }
    }
  }
}

// Symptom: with 160 MiB, eight callers of one process that also draws took 181.
TEST(CoordinatorMemoryTest, BesideAgentsFramesOfSeveralCallersHaveWhatOneHas) {
  const base::Cancellation never;
  const auto agent_limit = [](const frame::FrameSpec&) { return std::size_t{0}; };
  CoordinatorMemory memory(160 * kMiB, agent_limit);
  constexpr std::size_t kBesideAgents = (100 - 64) * kMiB;  // 5/8 of the limit without the program
  std::vector<base::MemoryBudget::Reservation> frames;
  for (int i = 0; i < 4; ++i) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto taken,
                                  memory.ReserveFrame(SpecOf(480, 480), kAtOnce, never));
    frames.push_back(std::move(taken));
    EXPECT_LE(memory.frame_bytes(), kBesideAgents);
  }
  const base::Cancellation soon(base::MonotonicNow() + absl::Milliseconds(20));
  EXPECT_THAT(memory.ReserveFrame(SpecOf(480, 480), kAtOnce, soon),
              StatusIs(absl::StatusCode::kDeadlineExceeded));
  frames.clear();
  // A larger one that could be drawn before is drawn alone.
  const frame::FrameSpec larger = SpecOf(1400, 1400);
  ASSERT_GT(FrameBytes(larger, Delivery::kWhole), kBesideAgents);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto alone, memory.ReserveFrame(larger, kAtOnce, never));
  EXPECT_EQ(memory.frame_bytes(), kBesideAgents);
  // Agents elsewhere leave all of the share.
  CoordinatorMemory apart(160 * kMiB);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto taken, apart.ReserveFrame(larger, kAtOnce, never));
  EXPECT_EQ(apart.frame_bytes(), FrameBytes(larger, Delivery::kWhole));
}

TEST(CoordinatorMemoryTest, TheMaskIsNeverDrawnInBands) {
  const CoordinatorMemory memory(160 * kMiB);
  frame::FrameSpec spec = SpecOf(2048, 2048);
  ISOSCOPE_EXPECT_OK(memory.CheckFits(spec, kInBands));
  EXPECT_FALSE(memory.CheckFits(spec, kAtOnce).ok());
  spec.culling = frame::Culling::kMask;
  EXPECT_THAT(memory.CheckFits(spec, kInBands), StatusIs(absl::StatusCode::kResourceExhausted,
                                                         ::testing::Not(HasSubstr("in bands"))));
}

TEST(CoordinatorMemoryTest, AgentsOfTheSameProcessGetThreeQuartersOfTheirLimit) {
  constexpr std::size_t kLimit = 256 * kMiB;
  // A pixel takes 64 bytes of the limit: 2000 x 2000 are a little less than all of it.
  const auto agent_limit = [](const frame::FrameSpec& spec) { return DrawnPixels(spec) * 64; };
  const CoordinatorMemory memory(kLimit, agent_limit);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BandGrid whole,
                                memory.PlanFrame(SpecOf(2000, 2000), kInBands, {}));
  EXPECT_EQ(whole.count(), 1);
  const frame::FrameSpec spec = SpecOf(2100, 2000);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BandGrid bands, memory.PlanFrame(spec, kInBands, {}));
  EXPECT_EQ(bands.count(), 2);
  EXPECT_LE(agent_limit(BandInTheMiddle(spec, bands.band())), kLimit / 4 * 3);
  // OpenGL takes the whole for each band: the agents say what they lack.
  const CoordinatorMemory of_open_gl(kLimit, [](const frame::FrameSpec&) { return kLimit + kMiB; });
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BandGrid at_once, of_open_gl.PlanFrame(spec, kInBands, {}));
  EXPECT_EQ(at_once.count(), 1);
}

// Symptom: the process of `isoscope view` exceeded its limit by planes of 8K beside its agents.
TEST(CoordinatorMemoryTest, PlanesBesideAgentsOfTheSameProcessMakeBandsSmaller) {
  constexpr std::size_t kLimit = 512 * kMiB;
  const auto agent_limit = [](const frame::FrameSpec& spec) {
    return std::max(CoordinatorMemory::kMinLimitBytes, DrawnPixels(spec) * 192);
  };
  const CoordinatorMemory together(kLimit, agent_limit);
  frame::FrameSpec picture = SpecOf(7680, 4320);
  picture.output.image_format = frame::ImageFormat::kPng;
  frame::FrameSpec depth = SpecOf(7680, 4320);
  depth.output.image_format = frame::ImageFormat::kNone;
  depth.output.depth = true;
  const std::size_t depth_bytes = std::size_t{7680} * 4320 * frame::kDepthBytes;
  const FrameWish in_parts{.delivery = Delivery::kParts, .may_band = true};
  const auto agents_take = [&](const frame::FrameSpec& spec) {
    const auto bands = together.PlanFrame(spec, in_parts, {});
    ISOSCOPE_EXPECT_OK(bands.status());
    return bands.ok() ? agent_limit(BandInTheMiddle(spec, bands->band())) : 0;
  };
  EXPECT_GT(agents_take(picture), (kLimit - 2 * depth_bytes) / 4 * 3);
  EXPECT_LE(agents_take(depth), (kLimit - 2 * depth_bytes) / 4 * 3);
  // Planes that leave agents less than their least limit are drawn in bands as pictures are.
  frame::FrameSpec position = SpecOf(5120, 2880);
  position.output.image_format = frame::ImageFormat::kNone;
  position.output.position = true;
  position.output.depth = true;
  EXPECT_GT(agents_take(position), std::size_t{0});
}

// Symptom: agents of the same process got the whole, and named the limit that the whole needs.
TEST(CoordinatorMemoryTest, ASmallestBandThatAgentsHaveNoRoomForIsRefusedBeforeAnyWork) {
  constexpr std::size_t kLimit = 256 * kMiB;
  const auto agent_limit = [](const frame::FrameSpec& spec) {
    return std::max(CoordinatorMemory::kMinLimitBytes, DrawnPixels(spec) * 1024);
  };
  const CoordinatorMemory memory(kLimit, agent_limit);
  for (const view::Viewport& size : {view::Viewport{400, 300}, {3000, 2000}}) {
    frame::FrameSpec spec = SpecOf(size.width_px, size.height_px);
    ISOSCOPE_EXPECT_OK(memory.PlanFrame(spec, kInBands, {}));
    spec.effects.samples_per_side = 4;
    spec.effects.ambient_occlusion = frame::AmbientOcclusion{.radius_px = 56};
    const absl::Status refused = memory.CheckFits(spec, kInBands);
    EXPECT_THAT(refused, StatusIs(absl::StatusCode::kResourceExhausted,
                                  AllOf(HasSubstr("one of 64 x 64 pixels with 16 samples and 64 "
                                                  "pixels around it for effects is too large: "),
                                        HasSubstr("ask for fewer samples, for a smaller "
                                                  "ambient_occlusion or silhouette, or raise"))));
    const auto named = static_cast<std::size_t>(NamedLimitMib(refused));
    ISOSCOPE_EXPECT_OK(CoordinatorMemory(named * kMiB, agent_limit).CheckFits(spec, kInBands));
    // Bands of equal size may be a little smaller than the smallest, and fit a little less.
    EXPECT_FALSE(
        CoordinatorMemory(named * kMiB / 5 * 4, agent_limit).CheckFits(spec, kInBands).ok());
  }
}

// Symptom: a picture of 16 samples was drawn in many bands to find what is visible, though these
// have one sample.
TEST(CoordinatorMemoryTest, ADrawingOfOneSampleHasFewBandsWithinWhatTheFrameHasTaken) {
  const base::Cancellation never;
  for (const std::size_t limit_mib : {std::size_t{96}, std::size_t{160}, std::size_t{2048}}) {
    for (const view::Viewport& size : {view::Viewport{900, 800}, {2000, 1500}, {500, 6000}}) {
      CoordinatorMemory memory(limit_mib * kMiB);
      frame::FrameSpec spec = SpecOf(size.width_px, size.height_px);
      frame::FrameSpec values = spec;
      values.output.image_format = frame::ImageFormat::kNone;
      spec.effects.samples_per_side = 4;
      spec.effects.ambient_occlusion = frame::AmbientOcclusion();
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto taken, memory.ReserveFrame(spec, kInBands, never));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BandGrid bands, memory.PlanFrame(spec, kInBands, {}));
      const std::size_t third = DrawnPixels(values) / 3;
      for (const std::size_t most : {std::size_t{0}, third}) {
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(
            const BandGrid of_values,
            memory.PlanDrawing(values, spec, kInBands, {.max_drawn_pixels = most}));
        const std::string name =
            absl::StrCat(limit_mib, " MiB, ", size.width_px, " pixels wide, ", most);
        const bool is_whole = of_values.count() == 1;
        EXPECT_LE(is_whole ? FrameBytes(values, Delivery::kParts)
                           : BandedBytesOf(values, of_values.band(), Delivery::kParts).most(),
                  memory.frame_bytes())
            << name;
        if (most > 0) {
          EXPECT_LE(DrawnPixels(BandInTheMiddle(values, of_values.band())), most) << name;
        } else if (bands.count() > 1) {
          EXPECT_LT(of_values.count(), bands.count()) << name;
        } else {
          EXPECT_TRUE(is_whole) << name;
        }
      }
    }
  }
}

TEST(CoordinatorMemoryTest, BandsGetSmallerForAgentsElsewhereAndForSetsOfManyBlocks) {
  const CoordinatorMemory memory(CoordinatorMemory::kMinLimitBytes);
  const frame::FrameSpec spec = SpecOf(1024, 1024);
  for (std::size_t most = DrawnPixels(spec) / 2; most >= std::size_t{64} * 64; most /= 2) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BandGrid bands,
                                  memory.PlanFrame(spec, kInBands, {.max_drawn_pixels = most}));
    EXPECT_GT(bands.count(), 1);
    EXPECT_LE(DrawnPixels(BandInTheMiddle(spec, bands.band())), most);
  }
  EXPECT_FALSE(memory.PlanFrame(spec, kInBands, {.max_drawn_pixels = 64 * 64 - 1}).ok());
  const frame::FrameSpec large = SpecOf(1500, 1500);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BandGrid few, memory.PlanFrame(large, kInBands, {}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BandGrid more,
                                memory.PlanFrame(large, kInBands, {.counting_bytes = 20 * kMiB}));
  EXPECT_GT(more.count(), few.count());
  const absl::Status refused =
      memory.PlanFrame(large, kInBands, {.counting_bytes = 90 * kMiB}).status();
  const auto named = static_cast<std::size_t>(NamedLimitMib(refused));
  ISOSCOPE_EXPECT_OK(
      CoordinatorMemory(named * kMiB).PlanFrame(large, kInBands, {.counting_bytes = 90 * kMiB}));
}

// Symptom: the sets of drawn blocks of a dataset of tens of millions were beside the reservation.
TEST(CoordinatorMemoryTest, SetsOfManyBlocksStayWithinWhatTheFrameHasTaken) {
  const base::Cancellation never;
  for (const std::size_t counting : {3 * kMiB, 9 * kMiB}) {
    for (const view::Viewport& size : {view::Viewport{2000, 1500}, {1300, 2500}}) {
      for (const std::size_t limit_mib : {std::size_t{128}, std::size_t{160}}) {
        CoordinatorMemory memory(limit_mib * kMiB);
        const frame::FrameSpec spec = SpecOf(size.width_px, size.height_px);
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto taken, memory.ReserveFrame(spec, kInBands, never));
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(
            const BandGrid bands, memory.PlanFrame(spec, kInBands, {.counting_bytes = counting}));
        EXPECT_GT(bands.count(), 1);
        EXPECT_LE(BandedBytesOf(spec, bands.band(), Delivery::kWhole).most() + counting,
                  memory.frame_bytes())
            << size.width_px << " x " << size.height_px << ", " << limit_mib << " MiB, "
            << counting / kMiB;
      }
    }
  }
}

// Symptom: a stream of planes that an agent elsewhere had no room for took more than was reserved.
TEST(CoordinatorMemoryTest, AFrameThatFitsAtOnceIsDrawnInBandsWithinWhatItHasTaken) {
  CoordinatorMemory memory(2048 * kMiB);
  const base::Cancellation never;
  constexpr std::size_t kCounting = 3 * kMiB;
  for (const bool has_planes : {false, true}) {
    for (const Delivery delivery : {Delivery::kWhole, Delivery::kParts}) {
      for (const view::Viewport& size : {view::Viewport{2048, 2048}, {3000, 500}, {500, 3000}}) {
        frame::FrameSpec spec = SpecOf(size.width_px, size.height_px);
        spec.effects.ambient_occlusion = frame::AmbientOcclusion{.radius_px = 56};
        spec.output.depth = has_planes;
        spec.output.position = has_planes;
        spec.output.normal = has_planes;
        spec.output.depth_bounds = has_planes;
        const FrameWish wish{.delivery = delivery, .may_band = true};
        std::size_t taken = 0;
        {
          ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto reservation,
                                        memory.ReserveFrame(spec, wish, never));
          taken = memory.frame_bytes();
        }
        for (const std::size_t most : {DrawnPixels(spec) - 1, DrawnPixels(spec) / 3}) {
          ISOSCOPE_ASSERT_OK_AND_ASSIGN(
              const BandGrid bands,
              memory.PlanFrame(spec, wish,
                               {.counting_bytes = kCounting, .max_drawn_pixels = most}));
          EXPECT_GT(bands.count(), 1);
          EXPECT_LE(BandedBytesOf(spec, bands.band(), delivery).most() + kCounting, taken)
              << size.width_px << " x " << size.height_px << " " << has_planes;
        }
      }
    }
  }
}

// Agents are asked for bounds when the bands are joined.
TEST(CoordinatorMemoryTest, AnswersOfBoundsCountOnceTheBandsAreGone) {
  frame::FrameSpec spec = SpecOf(4096, 4096);
  spec.output = {.image_format = frame::ImageFormat::kNone, .depth_bounds = true};
  const BandedBytes bytes = BandedBytesOf(spec, {64, 64}, Delivery::kParts);
  EXPECT_EQ(bytes.kept, (128 + 1) * kMiB);
  EXPECT_EQ(bytes.encode, (128 + 12 + 1) * kMiB);
}

TEST(CoordinatorMemoryTest, ATraceCountsAndTheSmallestLimitTakesOneOfACommonFrame) {
  const base::Cancellation never;
  CoordinatorMemory memory(CoordinatorMemory::kMinLimitBytes);
  EXPECT_GT(memory.max_trace_spans(), std::size_t{30'000});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto taken, memory.ReserveFrame(SpecOf(1024, 1024), {.has_trace = true}, never));
  EXPECT_EQ(memory.frame_bytes(),
            FrameBytes(SpecOf(1024, 1024), Delivery::kWhole) + memory.trace_bytes());
  ISOSCOPE_EXPECT_OK(memory.CheckFits(SpecOf(1200, 1200), kAtOnce));
  EXPECT_THAT(memory.CheckFits(SpecOf(1200, 1200), {.has_trace = true}),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("or for no trace")));
}

TEST(CoordinatorMemoryTest, AFrameWaitsUntilAnotherIsDoneOrItsTimeIsUp) {
  CoordinatorMemory memory(96 * kMiB);  // 54 for frames: one of 1024 x 1024
  base::Cancellation none;
  std::optional<base::MemoryBudget::Reservation> first;
  {
    auto taken = memory.ReserveFrame(SpecOf(1024, 1024), kAtOnce, none);
    ISOSCOPE_ASSERT_OK(taken);
    first.emplace(*std::move(taken));
  }
  base::Cancellation short_time(base::MonotonicNow() + absl::Milliseconds(30));
  EXPECT_THAT(memory.ReserveFrame(SpecOf(1024, 1024), kAtOnce, short_time),
              StatusIs(absl::StatusCode::kDeadlineExceeded));
  std::thread waiting(
      [&] { ISOSCOPE_EXPECT_OK(memory.ReserveFrame(SpecOf(1024, 1024), kAtOnce, none)); });
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
    ISOSCOPE_EXPECT_OK(memory.ReserveFrame(SpecOf(2048, 2048), kAtOnce, soon)) << i;
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

// Views keep pixels between tiles while they wait for frames: nobody may wait for those.
TEST(CoordinatorMemoryTest, PixelsOfTilesHaveAShareOfTheirOwnAndNeverWait) {
  CoordinatorMemory memory(CoordinatorMemory::kMinLimitBytes);
  EXPECT_GE(memory.tiles_bytes(), std::size_t{1024} * 1024 * 4) << "a view of 1024 x 1024 pixels";
  EXPECT_GT(memory.unused_image_bytes(), std::size_t{0});
  {
    const auto all = memory.TryKeepTiles(memory.tiles_bytes());
    EXPECT_TRUE(all.has_value());
    EXPECT_EQ(memory.frame_bytes(), std::size_t{0});
    EXPECT_FALSE(memory.TryKeepTiles(1).has_value());
  }
  EXPECT_FALSE(memory.TryKeepTiles(memory.tiles_bytes() + 1).has_value());
  EXPECT_TRUE(memory.TryKeepTiles(memory.tiles_bytes()).has_value());
}

}  // namespace
}  // namespace isoscope::server
