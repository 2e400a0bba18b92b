// A frame of one agent whose memory runs out at any allocation. The frame must end, with the right
// picture or RESOURCE_EXHAUSTED, and the next frame of the same agent must draw the right picture.
// Nothing may leak.
//
// Only operator new fails: what TBB, Zstandard and the kernel give out does not. Nobody calls gRPC
// or protobuf here. Both are not made for exceptions.

#include <optional>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"
#include <oneapi/tbb/global_control.h>

#include "core/base/no_memory.h"
#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/base/trace_recorder.h"
#include "core/mesh/compact_mesh.h"
#include "core/render/cpu_renderer.h"
#include "core/render/layer_pass.h"
#include "core/visibility/occluder_selection.h"
#include "partition-agent/cache/block_cache.h"
#include "partition-agent/frame/frame_pipeline.h"
#include "tests/support/memory_failure.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/partition-agent/small_dataset.h"

namespace isoscope::agent {
namespace {

using testing::IsOk;
using testing::MemoryFailure;

// The coordinator's messages for steps 2 and 3.
struct Plan {
  std::vector<volume::BlockId> occluders;
  std::vector<volume::BlockId> visible;
  std::string open_pixels;
};

struct Picture {
  image::FrameImage occluders;
  image::FrameImage rest;
  image::LayerStack layers;
  std::size_t band_count = 0;

  friend bool operator==(const Picture& a, const Picture& b) = default;
};

// The state that an agent keeps between frames.
class Agent {
 public:
  Agent(int thread_count, std::size_t max_kept_bytes)
      : arena_(thread_count),
        renderer_(render::MakeCpuRenderer(
            {.max_kept_bytes = max_kept_bytes, .max_unused_bytes = std::size_t{8} << 20})) {}

  // Draws a frame. `plan` may be null: then the frame has one step.
  absl::Status Draw(const Shards& shards, const FrameTask& task, const Plan* plan,
                    Picture* picture) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<FramePipeline> pipeline, Begin(shards, task));
    if (plan == nullptr) {
      ISOSCOPE_ASSIGN_OR_RETURN(picture->rest, pipeline->RenderAll());
    } else {
      ISOSCOPE_RETURN_IF_ERROR(pipeline->SelectOccluders().status());
      ISOSCOPE_ASSIGN_OR_RETURN(picture->occluders, pipeline->RenderOccluders(plan->occluders));
      ISOSCOPE_RETURN_IF_ERROR(Encode(pipeline.get(), picture->occluders, picture));
      ISOSCOPE_ASSIGN_OR_RETURN(picture->rest,
                                pipeline->RenderVisible(plan->visible, plan->open_pixels));
    }
    ISOSCOPE_RETURN_IF_ERROR(Encode(pipeline.get(), picture->rest, picture));
    picture->layers = pipeline->TakeLayers();
    return absl::OkStatus();
  }

  absl::StatusOr<std::unique_ptr<FramePipeline>> Begin(const Shards& shards,
                                                       const FrameTask& task) {
    return base::OrNoMemory("a frame", [&] {
      FrameTask numbered = task;
      numbered.frame_number = ++frame_number_;
      trace_ = std::make_unique<base::TraceRecorder>();
      return FramePipeline::Make(shards, numbered,
                                 {.renderer = renderer_.get(),
                                  .layers = &layers_,
                                  .arena = &arena_,
                                  .cache = &cache_,
                                  .trace = trace_.get()},
                                 &never_);
    });
  }

 private:
  static absl::Status Encode(FramePipeline* pipeline, const image::FrameImage& image,
                             Picture* picture) {
    return base::OrNoMemory("bands", [&] {
      picture->band_count += pipeline->Encode(image).size();
      return absl::OkStatus();
    });
  }

  base::TaskArena arena_;
  BlockCache cache_{std::size_t{8} << 20};
  render::LayerRenderer layers_{std::size_t{8} << 20};
  const std::unique_ptr<render::Renderer> renderer_;
  std::unique_ptr<base::TraceRecorder> trace_;
  const base::Cancellation never_;
  std::int64_t frame_number_ = 0;
};

struct Case {
  const char* name;
  frame::Culling culling = frame::Culling::kDepth;
  bool has_layers = false;
  bool has_caps = false;
  bool has_ties = false;
  std::size_t max_kept_bytes = std::size_t{512} << 20;
};

class FrameMemoryTest : public ::testing::TestWithParam<std::tuple<Case, int>> {
 protected:
  FrameMemoryTest() : case_(std::get<0>(GetParam())), thread_count_(std::get<1>(GetParam())) {
    task_ = dataset_.Request();
    task_.spec.viewport = {100, 76};
    task_.spec.culling = case_.culling;
    if (case_.has_layers) {
      task_.spec.surfaces.push_back({.rule = {.isovalue = 118}, .opacity = 0.4F});
      task_.spec.surfaces.push_back({.rule = {.isovalue = 136}, .opacity = 0.6F});
      task_.spec.max_layers = 3;
    }
    if (case_.has_ties) {
      task_.spec.surfaces.push_back({.rule = {.isovalue = testing::SmallDataset::kIsovalue}});
    }
    if (case_.has_caps) {
      const math::Box3d bounds = dataset_.geometry().Bounds();
      task_.spec.clip.half_spaces = {
          {{1, 0, 0}, bounds.min.x + 0.6 * (bounds.max.x - bounds.min.x)}};
      task_.spec.caps =
          frame::ClipCaps{.map = frame::ColorMap::kViridis, .range = frame::ColorRange{0, 255}};
    }
    if (case_.culling != frame::Culling::kNone) {
      MakePlan();
    }
  }

  // Makes the messages of a coordinator of this agent alone.
  void MakePlan() {
    Agent agent(thread_count_, case_.max_kept_bytes);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, agent.Begin(shards_, task_));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RaySelection selection, pipeline->SelectOccluders());
    const volume::BlockLayout layout = dataset_.layout();
    const view::View view = dataset_.ViewOf(task_);
    const volume::BlockSet active(layout.block_count(), selection.active);
    const volume::BlockSet hits(layout.block_count(), selection.hits);
    const volume::BlockSet occluding = visibility::OccludingBlocks(hits, layout, active);
    const view::Clipper clipper(task_.spec.clip, dataset_.geometry());
    plan_.emplace();
    for (const volume::BlockId id : selection.active) {
      const bool is_shown = !view.FootprintOf(layout, id).rect.empty() &&
                            clipper.SideOf(layout, id) != view::Clipper::Side::kOutside;
      if (is_shown && occluding.Contains(id)) {
        plan_->occluders.push_back(id);
      }
      if (is_shown && (case_.has_layers || !occluding.Contains(id))) {
        plan_->visible.push_back(id);
      }
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage image,
                                  pipeline->RenderOccluders(plan_->occluders));
    const auto map = visibility::OcclusionMap::FromImage(image, visibility::MapKind::kDepth);
    std::vector<image::PixelMask> masks;
    for (const volume::BlockId id : plan_->visible) {
      masks.push_back(map.OpenPixels(view.FootprintOf(layout, id)));
    }
    plan_->open_pixels = visibility::EncodeOpenPixels(masks);
  }

  absl::Status Draw(Agent* agent, Picture* picture) {
    return agent->Draw(shards_, task_, plan_ ? &*plan_ : nullptr, picture);
  }

  // Runs two frames of an agent: one in which the n-th allocation fails, and the next. Returns
  // false if there were fewer allocations.
  bool RunOut(std::int64_t nth, MemoryFailure::Mode mode, bool is_warm) {
    Agent agent(thread_count_, case_.max_kept_bytes);
    if (is_warm) {
      Picture before;
      EXPECT_THAT(Draw(&agent, &before), IsOk());
    }
    bool has_failed = false;
    {
      Picture picture;
      absl::Status status;
      {
        const MemoryFailure failure(nth, mode);
        status = Draw(&agent, &picture);
        has_failed = failure.has_come();
      }
      if (status.ok()) {
        EXPECT_TRUE(picture == expected_) << "another picture";
        ++survived_count_;
      } else {
        EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
        EXPECT_TRUE(has_failed);
      }
    }
    Picture next;
    EXPECT_THAT(Draw(&agent, &next), IsOk());
    EXPECT_TRUE(next == expected_) << "another picture after the frame that failed";
    return has_failed;
  }

  // More threads than this machine may have cores.
  const tbb::global_control threads_{tbb::global_control::max_allowed_parallelism, 3};
  const Case case_;
  const int thread_count_;
  testing::SmallDataset dataset_{2, {29, 25, 25}};
  Shards shards_ = dataset_.OpenShards();
  FrameTask task_;
  std::optional<Plan> plan_;
  Picture expected_;
  int survived_count_ = 0;
};

TEST_P(FrameMemoryTest, NoAllocationOfAFrameEndsTheAgentOrChangesAPicture) {
  {
    Agent agent(thread_count_, case_.max_kept_bytes);
    ISOSCOPE_ASSERT_OK(Draw(&agent, &expected_));
    EXPECT_EQ(!case_.has_layers, expected_.layers.empty());
  }
  for (const bool is_warm : {false, true}) {
    const auto run = [&](std::int64_t nth, MemoryFailure::Mode mode) {
      SCOPED_TRACE(absl::StrCat("allocation ", nth,
                                mode == MemoryFailure::Mode::kOnce ? "" : " and later",
                                is_warm ? ", warm" : ", cold"));
      const bool has_failed = RunOut(nth, mode, is_warm);
      return has_failed && !HasFailure();
    };
    run(1, MemoryFailure::Mode::kOnce);  // what is made once is made now
    survived_count_ = 0;
    const std::int64_t live_before = testing::LiveAllocationCount();
    const int run_count = testing::ForEachFailure(run);
    EXPECT_EQ(testing::LiveAllocationCount(), live_before) << "something leaked";
    EXPECT_GT(run_count, 100) << "the frame is too small";
    EXPECT_GT(run_count, 2 * survived_count_) << "failures are not noticed";
  }
}

std::string NameOf(const ::testing::TestParamInfo<std::tuple<Case, int>>& info) {
  return absl::StrCat(std::get<0>(info.param).name, "With", std::get<1>(info.param),
                      std::get<1>(info.param) == 1 ? "Thread" : "Threads");
}

INSTANTIATE_TEST_SUITE_P(
    Frames, FrameMemoryTest,
    ::testing::Combine(
        ::testing::Values(Case{.name = "CapsAndTies", .has_caps = true, .has_ties = true},
                          Case{.name = "Layers", .has_layers = true},
                          Case{.name = "ShadedEarly",
                               .culling = frame::Culling::kNone,
                               .has_ties = true,
                               .max_kept_bytes = std::size_t{1} << 14}),
        ::testing::Values(1, 3)),
    NameOf);

// A mesh of two triangles that cover the picture.
std::shared_ptr<const mesh::CompactMesh> Screen() {
  mesh::BlockMesh mesh;
  mesh.positions = {{0, 0, 4}, {8, 0, 4}, {0, 8, 4}, {8, 8, 4}};
  mesh.normals.assign(4, {0, 0, 1});
  mesh.indices = {0, 1, 2, 2, 1, 3};
  return mesh::Compact(mesh);
}

// The locks of the rows were kept: the thread waited for itself.
TEST(LayerPassMemoryTest, MemoryThatRunsOutLeavesNoRowLocked) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {9, 9, 9};
  const volume::BlockLayout layout = *volume::BlockLayout::Make({9, 9, 9}, {8, 8, 8});
  frame::FrameSpec spec;
  spec.surfaces = {{.rule = {.isovalue = 0}, .opacity = 0.5F}};
  spec.camera = view::MakeDefaultCamera(geometry.Bounds());
  spec.viewport = {64, 64};
  const view::View view = *view::View::Make(*spec.camera, spec.viewport, geometry);
  render::LayerRenderer renderer(0);
  const std::shared_ptr<const mesh::CompactMesh> screen = Screen();
  const std::vector<render::MeshToDraw> meshes{{screen, 0, nullptr}};
  const int run_count = testing::ForEachFailure([&](std::int64_t nth, MemoryFailure::Mode mode) {
    render::LayerPass pass(view, layout, spec, &renderer);
    absl::Status status;
    bool has_failed = false;
    {
      const MemoryFailure failure(nth, mode);
      status = pass.Add(meshes);
      has_failed = failure.has_come();
    }
    EXPECT_EQ(status.code(),
              has_failed ? absl::StatusCode::kResourceExhausted : absl::StatusCode::kOk);
    EXPECT_THAT(pass.Add(meshes), IsOk());
    EXPECT_FALSE(pass.Finish().empty());
    return has_failed;
  });
  EXPECT_GE(run_count, 4);
}

}  // namespace
}  // namespace isoscope::agent
