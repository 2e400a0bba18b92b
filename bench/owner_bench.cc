// Order, for frames 0, 1, 2 and 2 runs:
//
//   find owners   whole 0, 1, 2                          not counted; keeps owners and PNGs
//   run 1         whole 0, 1, 2; owners 0, 1, 2          each with an empty cache
//   run 2         whole 0, 1, 2; owners 0, 1, 2
//
// So both ways find the files in the page cache alike, and their own cache as a turned view leaves
// it. A link computes each step of the agent inside the call that requests it: with one agent
// nothing could overlap.

#include "bench/owner_bench.h"

#include <algorithm>
#include <memory>
#include <numbers>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"

#include "bench/sample_statistics.h"
#include "core/base/cancellation.h"
#include "core/base/check.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/cli/interrupt.h"
#include "core/cli/progress_line.h"
#include "core/frame/frame_spec.h"
#include "core/image/frame_image.h"
#include "core/image/png_codec.h"
#include "core/io/read_queue.h"
#include "core/render/cpu_renderer.h"
#include "core/store/shard_reader.h"
#include "core/view/view.h"
#include "partition-agent/cache/block_cache.h"
#include "partition-agent/frame/frame_pipeline.h"
#include "partition-agent/shard/shard.h"
#include "server/frame/active_blocks.h"
#include "server/frame/agent_link.h"
#include "server/frame/frame_coordinator.h"

namespace isoscope::bench {
namespace {

constexpr std::size_t kUnusedImageBytes = std::size_t{64} << 20;

struct Drawn {
  std::string png;
  std::vector<volume::BlockId> owners;  // ascending
  OwnerFigures figures;
};

double MillisecondsSince(base::MonotonicTime start) {
  return absl::ToDoubleMilliseconds(base::MonotonicNow() - start);
}

// The agent, for the coordinator's frame.
class DirectLink final : public server::AgentLink {
 public:
  DirectLink(std::unique_ptr<agent::FramePipeline> pipeline, server::AgentIdentity identity,
             server::AgentListener* listener)
      : pipeline_(std::move(pipeline)), identity_(std::move(identity)), listener_(listener) {}
  ~DirectLink() override { End(absl::CancelledError("the frame was abandoned")); }

  // Steps 0 and 1.
  void Begin() {
    absl::StatusOr<agent::RaySelection> selection = pipeline_->SelectOccluders();
    if (!selection.ok()) {
      End(selection.status());
      return;
    }
    listener_->OnRayHits(std::move(selection->hits), std::move(selection->active));
  }
  void SendOccluders(const std::vector<volume::BlockId>& blocks) override {
    if (!has_ended_ && SendPixels(pipeline_->RenderOccluders(blocks))) {
      listener_->OnOccludersDone();
    }
  }
  void SendVisibleBlocks(const std::vector<volume::BlockId>& blocks,
                         std::string open_pixels) override {
    if (!has_ended_ && SendPixels(pipeline_->RenderVisible(blocks, open_pixels))) {
      frame::AgentStatistics statistics = pipeline_->statistics();
      statistics.shard_indices = identity_.shard_indices;
      listener_->OnFrameDone(std::move(statistics));
      End(absl::OkStatus());
    }
  }
  void Cancel() override { End(absl::CancelledError("cancelled by the coordinator")); }
  [[nodiscard]] const server::AgentIdentity& agent() const override { return identity_; }
  [[nodiscard]] std::int64_t network_bytes() const override { return 0; }

 private:
  // Returns false after an error.
  bool SendPixels(absl::StatusOr<image::FrameImage> image) {
    if (!image.ok()) {
      End(image.status());
      return false;
    }
    listener_->OnDrawnPixels(
        {.image = *std::move(image), .layers = pipeline_->TakeLayers(), .memory = nullptr});
    return true;
  }
  void End(absl::Status status) {
    if (!std::exchange(has_ended_, true)) {
      listener_->OnEnd(std::move(status));
    }
  }

  const std::unique_ptr<agent::FramePipeline> pipeline_;
  const server::AgentIdentity identity_;
  server::AgentListener* const listener_;
  bool has_ended_ = false;
};

// A coordinator and its agent, with an empty cache.
class Drawer {
 public:
  // All of them outlive it.
  Drawer(const agent::Shards& shards, const OwnerBenchPlan& plan, base::TaskArena* arena,
         render::Renderer* renderer, const base::Cancellation& cancellation)
      : shards_(shards),
        arena_(arena),
        renderer_(renderer),
        cancellation_(cancellation),
        cache_(plan.memory_limit_bytes / 2),
        max_read_bytes_(std::min(plan.memory_limit_bytes / 32, io::ReadQueueOptions().max_bytes)) {
    identity_.address = "agent of this process";
    for (const std::shared_ptr<const agent::Shard>& shard : shards_) {
      identity_.shard_indices.push_back(shard->reader->shard_index());
    }
  }

  // Draws the whole frame. From the second one on, its active blocks are known, as in a server.
  absl::StatusOr<Drawn> DrawWhole(const frame::FrameSpec& spec) {
    const base::MonotonicTime start = base::MonotonicNow();
    ISOSCOPE_ASSIGN_OR_RETURN(const view::View view, ViewOf(spec));
    server::FrameSetup setup;
    setup.spec = &spec;
    setup.view = &view;
    setup.ties = frame::TieRuleOf(frame::BackEnd::kCpu);
    setup.layout = &layout();
    setup.replica_counts = {1};
    setup.active = active_;
    setup.images = images_.get();
    setup.arena = arena_;
    const auto begin =
        [&](int /*part_index*/, int /*replica_index*/,
            server::AgentListener* listener) -> absl::StatusOr<std::unique_ptr<server::AgentLink>> {
      ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<agent::FramePipeline> pipeline,
                                MakePipeline(spec, active_ == nullptr));
      auto link = std::make_unique<DirectLink>(std::move(pipeline), identity_, listener);
      link->Begin();
      return link;
    };
    server::FrameOutcome outcome = server::RunFrame(setup, begin, cancellation_);
    ISOSCOPE_RETURN_IF_ERROR(outcome.status);
    if (active_ == nullptr) {
      active_ = outcome.result.active;
    }
    Drawn drawn;
    drawn.png = Encode(outcome.result.image, spec);
    drawn.figures.ms = MillisecondsSince(start);
    for (const frame::AgentStatistics& agent : outcome.result.agents) {
      drawn.figures.block_count += static_cast<double>(agent.visible_block_count);
      drawn.figures.triangle_count += static_cast<double>(agent.triangle_count);
      active_block_count_ = static_cast<double>(agent.active_block_count);
    }
    drawn.owners = OwnersOf(outcome.result.image);
    return drawn;
  }

  // Draws the frame from `blocks`, ascending.
  absl::StatusOr<Drawn> DrawBlocks(const frame::FrameSpec& spec,
                                   const std::vector<volume::BlockId>& blocks) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<agent::FramePipeline> pipeline,
                              MakePipeline(spec, /*report_active_blocks=*/false));
    // Finds where the blocks lie; nothing else of it is used.
    ISOSCOPE_RETURN_IF_ERROR(pipeline->SelectOccluders().status());
    const base::MonotonicTime start = base::MonotonicNow();
    ISOSCOPE_ASSIGN_OR_RETURN(const image::FrameImage image, pipeline->RenderOccluders(blocks));
    Drawn drawn;
    drawn.png = Encode(image, spec);
    drawn.figures = {.ms = MillisecondsSince(start),
                     .block_count = static_cast<double>(blocks.size()),
                     .triangle_count = static_cast<double>(pipeline->statistics().triangle_count)};
    return drawn;
  }

  [[nodiscard]] double active_block_count() const { return active_block_count_; }

 private:
  [[nodiscard]] const volume::BlockLayout& layout() const {
    return shards_.front()->reader->layout();
  }
  [[nodiscard]] absl::StatusOr<view::View> ViewOf(const frame::FrameSpec& spec) const {
    return view::View::Make(*spec.camera, spec.viewport,
                            shards_.front()->reader->manifest().geometry);
  }
  absl::StatusOr<std::unique_ptr<agent::FramePipeline>> MakePipeline(const frame::FrameSpec& spec,
                                                                     bool report_active_blocks) {
    agent::FrameTask task;
    task.spec = spec;
    task.report_active_blocks = report_active_blocks;
    return agent::FramePipeline::Make(shards_, task,
                                      {.renderer = renderer_,
                                       .arena = arena_,
                                       .cache = &cache_,
                                       .max_read_bytes = max_read_bytes_},
                                      &cancellation_);
  }
  std::string Encode(const image::FrameImage& image, const frame::FrameSpec& spec) {
    return base::RunIn(arena_, [&] {
      return image::EncodePng(image.width, image.height, image.colors, spec.background_color);
    });
  }
  [[nodiscard]] std::vector<volume::BlockId> OwnersOf(const image::FrameImage& image) const {
    const auto block_count = static_cast<std::uint32_t>(layout().block_count());
    std::vector<volume::BlockId> owners;
    for (const std::uint64_t key : image.keys) {
      const std::uint32_t owner = image::OwnerOf(key);
      // Neighbouring pixels have the same owner, as a rule.
      if (owner != image::kNoOwner && (owners.empty() || owners.back() != owner % block_count)) {
        owners.push_back(owner % block_count);
      }
    }
    std::sort(owners.begin(), owners.end());
    owners.erase(std::unique(owners.begin(), owners.end()), owners.end());
    return owners;
  }

  const agent::Shards& shards_;
  base::TaskArena* const arena_;
  render::Renderer* const renderer_;
  const base::Cancellation& cancellation_;
  agent::BlockCache cache_;
  const std::size_t max_read_bytes_;
  server::AgentIdentity identity_;
  const std::shared_ptr<image::FrameImagePool> images_ =
      image::FrameImagePool::Make(kUnusedImageBytes);
  std::shared_ptr<const server::ActiveBlocks> active_;
  double active_block_count_ = 0;
};

frame::FrameSpec SpecOf(const OwnerBenchPlan& plan, const volume::GridGeometry& geometry,
                        int frame) {
  frame::FrameSpec spec;
  spec.surfaces.emplace_back().rule.isovalue = plan.isovalue;
  view::Camera camera = view::MakeDefaultCamera(geometry.Bounds());
  constexpr double kRadiansPerDegree = std::numbers::pi / 180;
  view::Azimuth(plan.azimuth_degrees * kRadiansPerDegree, &camera);
  view::Elevation(plan.elevation_degrees * kRadiansPerDegree, &camera);
  view::OrthogonalizeUp(&camera);
  view::Azimuth(frame * plan.orbit_degrees * kRadiansPerDegree, &camera);
  spec.camera = camera;
  spec.viewport = plan.viewport;
  return spec;
}

OwnerFigures MedianOf(const std::vector<OwnerFigures>& of) {
  const auto median = [&](double OwnerFigures::*figure) {
    std::vector<double> values;
    values.reserve(of.size());
    for (const OwnerFigures& one : of) {
      values.push_back(one.*figure);
    }
    return Median(std::move(values));
  };
  return {.ms = median(&OwnerFigures::ms),
          .block_count = median(&OwnerFigures::block_count),
          .triangle_count = median(&OwnerFigures::triangle_count)};
}

// The bench on an open dataset.
class OwnerBench {
 public:
  OwnerBench(const OwnerBenchPlan& plan, agent::Shards shards, const cli::Context& context)
      : plan_(plan),
        shards_(std::move(shards)),
        context_(context),
        arena_(std::make_shared<base::TaskArena>(plan.thread_count)),
        renderer_(render::MakeCpuRenderer({.max_kept_bytes = plan.memory_limit_bytes / 16,
                                           .max_unused_bytes = plan.memory_limit_bytes / 16,
                                           .arena = arena_})),
        line_(context.err, context.err_is_terminal) {
    for (int frame = 0; frame < plan_.frame_count; ++frame) {
      specs_.push_back(SpecOf(plan_, shards_.front()->reader->manifest().geometry, frame));
    }
  }

  absl::StatusOr<OwnerBenchResult> Run() {
    OwnerBenchResult result;
    ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<OwnerFigures> found,
                              DrawFrames("finding owners", &result, /*of_owners=*/false));
    std::vector<OwnerFigures> whole;
    std::vector<OwnerFigures> owners;
    for (int run = 0; run < plan_.run_count; ++run) {
      const std::string name = absl::StrCat("run ", run + 1, " of ", plan_.run_count);
      ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<OwnerFigures> of_whole,
                                DrawFrames(name + ", whole frames", &result, false));
      ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<OwnerFigures> of_owners,
                                DrawFrames(name + ", owners", &result, true));
      whole.push_back(MedianOf({of_whole.begin() + 1, of_whole.end()}));
      owners.push_back(MedianOf({of_owners.begin() + 1, of_owners.end()}));
      for (const auto& [figures, ms] :
           {std::pair(&of_whole, &result.whole_ms), std::pair(&of_owners, &result.owners_ms)}) {
        std::vector<double>& times = ms->emplace_back();
        for (const OwnerFigures& frame : *figures) {
          times.push_back(frame.ms);
        }
      }
    }
    result.whole = MedianOf(whole);
    result.owners = MedianOf(owners);
    return result;
  }

 private:
  // Draws all frames one way, with an empty cache.
  absl::StatusOr<std::vector<OwnerFigures>> DrawFrames(const std::string& name,
                                                       OwnerBenchResult* result, bool of_owners) {
    Drawer drawer(shards_, plan_, arena_.get(), renderer_.get(),
                  context_.interrupt->cancellation());
    std::vector<OwnerFigures> figures;
    for (std::size_t i = 0; i < specs_.size(); ++i) {
      line_.Update(absl::StrCat(name, ", frame ", i + 1));
      ISOSCOPE_ASSIGN_OR_RETURN(Drawn drawn, of_owners ? drawer.DrawBlocks(specs_[i], owners_[i])
                                                       : drawer.DrawWhole(specs_[i]));
      figures.push_back(drawn.figures);
      if (pngs_.size() == i) {
        pngs_.push_back(std::move(drawn.png));
        owners_.push_back(std::move(drawn.owners));
      } else if (drawn.png != pngs_[i]) {
        return absl::InternalError(absl::StrCat("frame ", i,
                                                of_owners ? " of the blocks that own a pixel" : "",
                                                " is not the first picture of it"));
      }
    }
    if (!of_owners) {
      result->active_block_count = drawer.active_block_count();
    }
    return figures;
  }

  const OwnerBenchPlan& plan_;
  const agent::Shards shards_;
  const cli::Context& context_;
  const std::shared_ptr<base::TaskArena> arena_;
  const std::unique_ptr<render::Renderer> renderer_;
  cli::ProgressLine line_;
  std::vector<frame::FrameSpec> specs_;
  // By frame.
  std::vector<std::string> pngs_;
  std::vector<std::vector<volume::BlockId>> owners_;
};

}  // namespace

absl::StatusOr<OwnerBenchResult> RunOwnerBench(const OwnerBenchPlan& plan,
                                               const cli::Context& context) {
  ISOSCOPE_CHECK(plan.frame_count >= 2);
  ISOSCOPE_ASSIGN_OR_RETURN(const store::DatasetDescription dataset,
                            store::OpenDataset(plan.directory));
  agent::Shards shards;
  for (const std::string& directory : dataset.shard_directories) {
    ISOSCOPE_ASSIGN_OR_RETURN(shards.emplace_back(), agent::OpenShard(directory));
  }
  return OwnerBench(plan, std::move(shards), context).Run();
}

}  // namespace isoscope::bench
