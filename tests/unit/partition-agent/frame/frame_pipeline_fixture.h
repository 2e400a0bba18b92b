// Runs frames of one agent without a coordinator, for the tests of FramePipeline. Each test draws
// how many threads there are, and how much memory.

#ifndef ISOSCOPE_TESTS_UNIT_PARTITION_AGENT_FRAME_FRAME_PIPELINE_FIXTURE_H_
#define ISOSCOPE_TESTS_UNIT_PARTITION_AGENT_FRAME_FRAME_PIPELINE_FIXTURE_H_

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/base/task_arena.h"
#include "core/composite/depth_composite.h"
#include "core/image/frame_image.h"
#include "core/render/layer_pass.h"
#include "core/render/renderer_factory.h"
#include "core/visibility/occluder_selection.h"
#include "partition-agent/cache/block_cache.h"
#include "partition-agent/frame/frame_pipeline.h"
#include "tests/support/draws.h"
#include "tests/support/only_arena.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/partition-agent/small_dataset.h"

namespace isoscope::agent {

inline constexpr image::FragmentOrder kOrder{.block_count = 1 << 20,
                                             .ties = image::TieRule::kColor};

// One whole frame of one agent: both images composited, and what it took.
struct Frame {
  RaySelection selection;
  std::vector<volume::BlockId> occluding_blocks;
  std::vector<volume::BlockId> visible_blocks;
  image::FrameImage occluders;
  image::FrameImage image;
  frame::AgentStatistics after_selection;
  frame::AgentStatistics statistics;
};

// Compares the values that depend neither on the number of threads nor on caches.
inline void ExpectSameWork(const Frame& frame, const Frame& expected) {
  EXPECT_EQ(frame.selection.hits, expected.selection.hits);
  EXPECT_EQ(frame.selection.active, expected.selection.active);
  EXPECT_TRUE(frame.occluders == expected.occluders);
  EXPECT_TRUE(frame.image == expected.image);
  EXPECT_EQ(frame.statistics.active_block_count, expected.statistics.active_block_count);
  EXPECT_EQ(frame.statistics.occluding_block_count, expected.statistics.occluding_block_count);
  EXPECT_EQ(frame.statistics.visible_block_count, expected.statistics.visible_block_count);
  EXPECT_EQ(frame.statistics.triangle_count, expected.statistics.triangle_count);
  EXPECT_EQ(frame.statistics.unique_vertex_count, expected.statistics.unique_vertex_count);
}

class FramePipelineTest : public ::testing::Test {
 protected:
  void SetUp() override {
    testing::Dice dice(testing::DrawSeed());
    Use(testing::DrawLimits(&dice));
  }

  // Makes a dataset for the frames.
  void Open(int shard_count) {
    dataset_ = std::make_unique<testing::SmallDataset>(shard_count);
    shards_ = dataset_->OpenShards();
    task_ = dataset_->Request();
  }

  // Takes other threads, and a renderer of other limits.
  void Use(const testing::Limits& limits) {
    trace_.emplace(__FILE__, __LINE__, ::testing::Message() << limits);
    limits_ = limits;
    renderer_.reset();
    arena_.reset();  // one at a time
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(arena_, testing::MakeOnlyArena(limits.thread_count));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        renderer_, render::MakeRenderer({.kind = render::RendererKind::kCpu,
                                         .max_kept_mesh_bytes = limits.kept_mesh_bytes(),
                                         .max_unused_bytes = limits.unused_image_bytes(),
                                         .arena = arena_}));
    layers_ = std::make_unique<render::LayerRenderer>(limits.unused_layer_bytes());
  }

  absl::StatusOr<std::unique_ptr<FramePipeline>> Make(
      const Shards& shards, const FrameTask& request,
      const base::Cancellation* cancellation = nullptr,
      const std::vector<Shards>& color_shards = {}) {
    FrameTask numbered = request;
    numbered.frame_number = frame_number_.fetch_add(1);
    return FramePipeline::Make(shards, numbered, Resources(),
                               cancellation == nullptr ? &never_ : cancellation, color_shards);
  }
  [[nodiscard]] AgentResources Resources() const {
    return {.renderer = renderer_.get(),
            .layers = layers_.get(),
            .arena = arena_.get(),
            .cache = cache_.get(),
            .max_read_bytes = limits_.read_bytes()};
  }
  [[nodiscard]] static image::FrameImage EmptyImage(const FrameTask& request) {
    return {request.spec.viewport.width_px, request.spec.viewport.height_px};
  }
  void ForgetAll() { cache_ = std::make_unique<BlockCache>(kAmpleCacheBytes); }

  void RunAlone(const FrameTask& request, Frame* frame) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(shards_, request));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(frame->selection, pipeline->SelectOccluders());
    frame->after_selection = pipeline->statistics();
    const volume::BlockLayout layout = dataset_->layout();
    const volume::BlockSet active(layout.block_count(), frame->selection.active);
    const volume::BlockSet hits(layout.block_count(), frame->selection.hits);
    // The coordinator sends those that are in the picture.
    const view::View view = dataset_->ViewOf(request);
    frame->occluding_blocks.clear();
    for (const volume::BlockId id : visibility::OccludingBlocks(hits, layout, active).Ids()) {
      if (!view.FootprintOf(layout, id).rect.empty()) {
        frame->occluding_blocks.push_back(id);
      }
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(frame->occluders,
                                  pipeline->RenderOccluders(frame->occluding_blocks));
    std::string open_pixels;
    std::tie(frame->visible_blocks, open_pixels) = dataset_->VisibleOf(
        request, frame->selection.active, frame->occluding_blocks, frame->occluders);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(frame->image,
                                  pipeline->RenderVisible(frame->visible_blocks, open_pixels));
    composite::CompositeInto(frame->occluders, kOrder, &frame->image);
    frame->statistics = pipeline->statistics();
  }

  // Returns a frame that expects step 2, or step 3 after no occluders.
  std::unique_ptr<FramePipeline> MakeSelected() {
    auto pipeline = Make(shards_, task_);
    EXPECT_THAT(pipeline, testing::IsOk());
    EXPECT_THAT((*pipeline)->SelectOccluders(), testing::IsOk());
    return *std::move(pipeline);
  }
  std::unique_ptr<FramePipeline> MakeWithoutOccluders() {
    std::unique_ptr<FramePipeline> pipeline = MakeSelected();
    EXPECT_THAT(pipeline->RenderOccluders({}), testing::IsOk());
    return pipeline;
  }

  image::FrameImage RenderAll(const Shards& shards, const FrameTask& request,
                              frame::AgentStatistics* statistics = nullptr) {
    const auto pipeline = Make(shards, request);
    EXPECT_THAT(pipeline, testing::IsOk());
    auto image = (*pipeline)->RenderAll();
    EXPECT_THAT(image, testing::IsOk());
    if (statistics != nullptr) {
      *statistics = (*pipeline)->statistics();
    }
    return *std::move(image);
  }

  std::unique_ptr<testing::SmallDataset> dataset_;
  Shards shards_;
  FrameTask task_;
  testing::Limits limits_;
  std::shared_ptr<base::TaskArena> arena_;
  std::unique_ptr<render::Renderer> renderer_;
  std::unique_ptr<render::LayerRenderer> layers_;
  static constexpr std::size_t kAmpleCacheBytes = std::size_t{1} << 30;
  // Sizes for nothing; some samples; samples and one segment of meshes; everything.
  static constexpr std::size_t kCacheSizes[] = {std::size_t{1} << 16, std::size_t{1} << 20,
                                                std::size_t{1} << 21, kAmpleCacheBytes};
  std::unique_ptr<BlockCache> cache_ = std::make_unique<BlockCache>(kAmpleCacheBytes);
  const base::Cancellation never_;
  std::atomic<std::int64_t> frame_number_{1};  // each pipeline is a frame of its own
  std::optional<::testing::ScopedTrace> trace_;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_TESTS_UNIT_PARTITION_AGENT_FRAME_FRAME_PIPELINE_FIXTURE_H_
