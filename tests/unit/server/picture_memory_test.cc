// A frame on the coordinator whose memory runs out at any allocation: from the agents' bands to the
// bytes of the picture. It must end, with the right picture or RESOURCE_EXHAUSTED, and the next
// frame must give the right picture. Nothing may leak.
//
// Only operator new fails. Agents are played without gRPC, which is not made for exceptions.

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"
#include <oneapi/tbb/global_control.h>

#include "core/base/cancellation.h"
#include "core/base/no_memory.h"
#include "core/base/random.h"
#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/composite/pixel_codec.h"
#include "server/frame/frame_coordinator.h"
#include "server/picture/frame_output.h"
#include "server/picture/picture_finish.h"
#include "tests/support/memory_failure.h"
#include "tests/support/status_matchers.h"

namespace isoscope::server {
namespace {

using testing::IsOk;
using testing::MemoryFailure;
using testing::SparedFromFailure;

constexpr int kWidth = 70;
constexpr int kHeight = 50;
constexpr math::Index3 kDims{17, 17, 17};
constexpr volume::BlockId kBlockCount = 64;  // of 4^3 cells
constexpr image::FragmentOrder kOrder{.block_count = kBlockCount, .ties = image::TieRule::kColor};

// Depths repeat, so that ties are settled.
image::FrameImage RandomImage(std::uint64_t seed, double coverage) {
  image::FrameImage image(kWidth, kHeight);
  std::uint64_t i = 0;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x, ++i) {
      if (base::RandomUnit(seed, 4 * i) < coverage) {
        const double depth = (1 + static_cast<int>(6 * base::RandomUnit(seed, 4 * i + 1))) / 8.0;
        const auto owner =
            static_cast<std::uint32_t>(kBlockCount * 2 * base::RandomUnit(seed, 4 * i + 2));
        const auto shade = static_cast<std::uint8_t>(owner);
        image.Set(x, y, image::FragmentKey(static_cast<float>(depth), owner),
                  {shade, 90, static_cast<std::uint8_t>(255 * depth), 255});
      }
    }
  }
  return image;
}

// An agent's messages in each of the two steps.
struct Played {
  std::vector<volume::BlockId> active;
  std::vector<std::vector<std::string>> occluders;
  std::vector<std::vector<std::string>> rest;
};

Played Play(volume::BlockId rest_of_two, image::FrameImagePool* images) {
  Played played;
  for (volume::BlockId id = rest_of_two; id < kBlockCount; id += 2) {
    played.active.push_back(id);
  }
  const auto add = [](std::vector<std::string> bands, auto* messages) {
    for (std::string& band : bands) {
      messages->push_back({std::move(band)});
    }
  };
  add(composite::EncodePixels(RandomImage(rest_of_two, 0.3)), &played.occluders);
  add(composite::EncodePixels(RandomImage(rest_of_two + 10, 0.5)), &played.rest);
  image::LayerStack layers(kWidth, kHeight, 3, kOrder, images);
  for (std::uint64_t level = 0; level < 3; ++level) {
    const image::FrameImage image = RandomImage(rest_of_two + 20 + level, 0.4);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const std::size_t i = image.IndexOf(x, y);
        if (image.keys[i] != image::kBackgroundKey) {
          layers.Insert(x, y, image.keys[i], image.colors[i]);
        }
      }
    }
  }
  add(composite::EncodeLayers(layers), &played.rest);
  return played;
}

// An agent that answers on the coordinator's own thread. Its messages are its own memory.
class PlayedLink final : public AgentLink {
 public:
  PlayedLink(const Played& played, int index, AgentListener* listener)
      : played_(played), identity_{"played", {index}}, listener_(*listener) {
    Spared([&] { return std::pair(played_.active, played_.active); },
           [&](auto blocks) { listener_.OnRayHits(std::move(blocks.first), blocks.second); });
  }
  ~PlayedLink() override { Cancel(); }

  void SendOccluders(const std::vector<volume::BlockId>& /*blocks*/) override {
    Send(played_.occluders);
    listener_.OnOccludersDone();
  }
  void SendVisibleBlocks(const std::vector<volume::BlockId>& /*blocks*/,
                         std::string /*open_pixels*/) override {
    Send(played_.rest);
    listener_.OnFrameDone({});
    End(absl::OkStatus());
  }
  void Cancel() override {
    Spared([] { return absl::CancelledError("cancelled"); },
           [this](absl::Status status) { End(std::move(status)); });
  }
  [[nodiscard]] const AgentIdentity& agent() const override { return identity_; }
  [[nodiscard]] std::int64_t network_bytes() const override { return 0; }

 private:
  // Passes what `make` makes, without failures, to `use`.
  template <typename Make, typename Use>
  static void Spared(const Make& make, const Use& use) {
    auto made = [&] {
      const SparedFromFailure spared;
      return make();
    }();
    use(std::move(made));
  }
  void Send(const std::vector<std::vector<std::string>>& messages) {
    for (const std::vector<std::string>& bands : messages) {
      Spared([&] { return bands; },
             [&](std::vector<std::string> copy) { listener_.OnPixels(std::move(copy)); });
    }
  }
  void End(absl::Status status) {
    if (!std::exchange(has_ended_, true)) {
      listener_.OnEnd(std::move(status));
    }
  }

  const Played& played_;
  const AgentIdentity identity_;
  AgentListener& listener_;
  bool has_ended_ = false;
};

struct Case {
  const char* name;
  frame::ImageFormat format = frame::ImageFormat::kPng;
  bool has_planes = false;
  frame::PictureEffects effects = {};
};

class PictureMemoryTest : public ::testing::TestWithParam<std::tuple<Case, int>> {
 protected:
  PictureMemoryTest() : arena_(std::get<1>(GetParam())) {
    const Case& of = std::get<0>(GetParam());
    geometry_.sample_dims = kDims;
    spec_.surfaces = {{.rule = {.isovalue = 1}}, {.rule = {.isovalue = 2}, .opacity = 0.5F}};
    spec_.camera = view::MakeDefaultCamera(geometry_.Bounds());
    spec_.viewport = {kWidth, kHeight};
    spec_.max_layers = 2;
    spec_.effects = of.effects;
    spec_.output.image_format = of.format;
    spec_.output.depth = spec_.output.surface_index = spec_.output.position = of.has_planes;
    for (const volume::BlockId index : {0U, 1U}) {
      base::RunIn(&arena_, [&] { played_.push_back(Play(index, images_.get())); });
    }
  }

  // Draws and finishes a frame.
  absl::Status Draw(FrameOutput* output) {
    const view::View view = *view::View::Make(*spec_.camera, spec_.viewport, geometry_);
    FrameOutcome outcome;
    FrameSetup setup;
    {
      const SparedFromFailure spared;
      setup.replica_counts = {1, 1};
    }
    setup.spec = &spec_;
    setup.view = &view;
    setup.layout = &layout_;
    setup.images = images_.get();
    setup.arena = &arena_;
    const BeginAgentFrame begin =
        [this](int part, int /*replica*/,
               AgentListener* listener) -> absl::StatusOr<std::unique_ptr<AgentLink>> {
      const SparedFromFailure spared;
      return std::make_unique<PlayedLink>(played_[static_cast<std::size_t>(part)], part, listener);
    };
    outcome = RunFrame(setup, begin, never_);
    ISOSCOPE_RETURN_IF_ERROR(outcome.status);
    FrameResult& result = outcome.result;
    return base::OrNoMemory("the picture", [&] {
      return base::RunIn(&arena_, [&]() -> absl::Status {
        const frame::DrawnWindow window = frame::DrawnWindowOf(spec_);
        const FinishedPicture finished = FinishPicture({.spec = &spec_,
                                                        .window = &window,
                                                        .drawn_view = &view,
                                                        .order = kOrder,
                                                        .layers = &result.layers,
                                                        .images = images_.get()},
                                                       &result.image);
        ISOSCOPE_ASSIGN_OR_RETURN(output->image, EncodePicture(finished.image, spec_));
        FillPlanes(finished.image, spec_, view, kOrder, output);
        return absl::OkStatus();
      });
    });
  }

  static bool AreSame(const FrameOutput& a, const FrameOutput& b) {
    return a.image == b.image && a.depth == b.depth && a.surface_index == b.surface_index &&
           a.position == b.position;
  }

  // Runs two frames: one in which the n-th allocation fails, and the next. Returns false if there
  // were fewer allocations.
  bool RunOut(std::int64_t nth, MemoryFailure::Mode mode) {
    images_ = image::FrameImagePool::Make(std::size_t{1} << 20);
    bool has_failed = false;
    {
      FrameOutput output;
      absl::Status status;
      {
        const MemoryFailure failure(nth, mode);
        status = Draw(&output);
        has_failed = failure.has_come();
      }
      if (status.ok()) {
        EXPECT_TRUE(AreSame(output, expected_)) << "another picture";
        ++survived_count_;
      } else {
        EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
        EXPECT_TRUE(has_failed);
      }
    }
    {
      FrameOutput next;
      EXPECT_THAT(Draw(&next), IsOk());
      EXPECT_TRUE(AreSame(next, expected_)) << "another picture after the frame that failed";
    }
    images_.reset();
    return has_failed;
  }

  // More threads than this machine may have cores.
  const tbb::global_control threads_{tbb::global_control::max_allowed_parallelism, 3};
  volume::GridGeometry geometry_;
  const volume::BlockLayout layout_ = *volume::BlockLayout::Make(kDims, {4, 4, 4});
  frame::FrameSpec spec_;
  base::TaskArena arena_;
  std::shared_ptr<image::FrameImagePool> images_ =
      image::FrameImagePool::Make(std::size_t{1} << 20);
  std::vector<Played> played_;
  const base::Cancellation never_;
  FrameOutput expected_;
  int survived_count_ = 0;
};

TEST_P(PictureMemoryTest, NoAllocationOfAFrameEndsTheCoordinatorOrChangesAPicture) {
  ISOSCOPE_ASSERT_OK(Draw(&expected_));
  EXPECT_FALSE(expected_.image.empty());
  const auto run = [&](std::int64_t nth, MemoryFailure::Mode mode) {
    SCOPED_TRACE(
        absl::StrCat("allocation ", nth, mode == MemoryFailure::Mode::kOnce ? "" : " and later"));
    const bool has_failed = RunOut(nth, mode);
    return has_failed && !HasFailure();
  };
  // One-time allocations happen here; the list of callbacks would otherwise be allocated by the
  // first wait.
  {
    const base::Cancellation::Callback callback(never_, [] {});
  }
  run(1, MemoryFailure::Mode::kOnce);
  survived_count_ = 0;
  const std::int64_t live_before = testing::LiveAllocationCount();
  const int run_count = testing::ForEachFailure(run);
  EXPECT_EQ(testing::LiveAllocationCount(), live_before) << "something leaked";
  EXPECT_GT(run_count, 100) << "the frame is too small";
  EXPECT_GT(run_count, 2 * survived_count_) << "failures are not noticed";
}

std::string NameOf(const ::testing::TestParamInfo<std::tuple<Case, int>>& info) {
  return absl::StrCat(std::get<0>(info.param).name, "With", std::get<1>(info.param),
                      std::get<1>(info.param) == 1 ? "Thread" : "Threads");
}

INSTANTIATE_TEST_SUITE_P(
    Frames, PictureMemoryTest,
    ::testing::Combine(
        ::testing::Values(
            Case{.name = "PngWithEffects",
                 .effects = {.samples_per_side = 1,
                             .ambient_occlusion = frame::AmbientOcclusion{},
                             .silhouette = frame::Silhouette{}}},
            Case{.name = "RawWithPlanes", .format = frame::ImageFormat::kRgba8, .has_planes = true},
            Case{.name = "Jpeg", .format = frame::ImageFormat::kJpeg}),
        ::testing::Values(1, 3)),
    NameOf);

}  // namespace
}  // namespace isoscope::server
