// One agent's frame, step by step:
//
//   step  asks                                        of
//   0     which blocks do the surfaces meet?          SurfaceBlocks: cache, else interval trees
//   1     what do the agent's rays hit?               visibility::RaySet over the range table
//   2     meshes of the occluding blocks, drawn       MeshSupply, render::RenderPass
//   3     meshes of the other visible blocks, drawn   the same, within their open pixels
//
// Translucent surfaces occlude nothing: no ray looks for them, and step 3 draws them for all
// blocks, within what the opaque occluders leave open (render::LayerPass).
//
// The caps of clip planes are drawn with the occluders, so that they hide blocks too (cap_drawing).
//
// Steps 0 and 1 run concurrently: rays need only the range table of the whole volume. The arena
// casts rays. The frame's thread reads tree pages outside of the arena, which never waits for a
// disk. With kNone step 0 is followed by one pass over all blocks.

#include "partition-agent/frame/frame_pipeline.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <optional>
#include <span>

#include "absl/strings/str_cat.h"
#include "absl/types/span.h"
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/partitioner.h>
#include <oneapi/tbb/task_group.h>

#include "core/base/check.h"
#include "core/base/scoped_timer.h"
#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/composite/pixel_codec.h"
#include "core/visibility/open_pixels.h"
#include "partition-agent/frame/cap_drawing.h"
#include "partition-agent/frame/occluder_rays.h"
#include "partition-agent/frame/step_memory.h"

namespace isoscope::agent {
namespace {

// One task computes the footprints of this many blocks.
constexpr std::size_t kFootprintsPerTask = 128;

// The volumes that colour the frame's surfaces.
absl::StatusOr<ColorVolumes> ColorsOf(const frame::FrameSpec& spec, const Shards& shards,
                                      const std::vector<Shards>& color_shards) {
  if (!spec.sends_map_steps) {
    return ColorVolumes();
  }
  std::vector<Shards> by_surface(spec.surfaces.size());
  for (std::size_t i = 0; i < by_surface.size(); ++i) {
    if (!spec.surfaces[i].shows_field()) {
      continue;
    }
    if (i >= color_shards.size() || color_shards[i].empty()) {
      return absl::InvalidArgumentError(absl::StrCat(
          "surface ", i, " shows another field, but the frame does not name its samples"));
    }
    by_surface[i] = color_shards[i];
  }
  return ColorVolumes::Make(shards, by_surface);
}

render::Renderer& RendererOf(const frame::FrameSpec& spec, const AgentResources& resources) {
  const bool only_cpu = frame::ShowsValues(spec) && resources.cpu_renderer != nullptr;
  return only_cpu ? *resources.cpu_renderer : *resources.renderer;
}

bool IsTranslucent(const frame::FrameSpec& spec, std::size_t surface_index) {
  return spec.surfaces[surface_index].is_translucent();
}

// Returns the pixels that each block can cover. The shape of its open pixels follows from them.
std::vector<view::PixelRect> RectsOf(const std::vector<volume::BlockId>& blocks,
                                     const view::View& view, const volume::BlockLayout& layout,
                                     base::TaskArena* arena) {
  std::vector<view::PixelRect> rects(blocks.size());
  base::RunIn(arena, [&] {
    tbb::parallel_for(
        tbb::blocked_range<std::size_t>(0, blocks.size(), kFootprintsPerTask),
        [&](const tbb::blocked_range<std::size_t>& range) {
          std::array<view::Footprint, kFootprintsPerTask> footprints;
          view.FootprintsOf(layout, absl::MakeSpan(blocks).subspan(range.begin(), range.size()),
                            absl::MakeSpan(footprints).first(range.size()));
          for (std::size_t i = 0; i < range.size(); ++i) {
            rects[range.begin() + i] = footprints[i].rect;
          }
        },
        tbb::simple_partitioner());
  });
  return rects;
}

// Draws what is added: opaque meshes into `pass`, translucent ones into `layer_pass`, which is
// null if there are none.
class PassSink final : public MeshSink {
 public:
  PassSink(const frame::FrameSpec& spec, render::RenderPass* pass, render::LayerPass* layer_pass,
           const base::Cancellation& cancellation)
      : spec_(spec), pass_(*pass), layer_pass_(layer_pass), cancellation_(cancellation) {}

  absl::Status Add(std::span<const render::MeshToDraw> meshes) override {
    if (layer_pass_ == nullptr) {
      return pass_.Add(meshes);
    }
    std::vector<render::MeshToDraw> sorted(meshes.begin(), meshes.end());
    const auto translucent =
        std::stable_partition(sorted.begin(), sorted.end(), [this](const render::MeshToDraw& mesh) {
          return !IsTranslucent(spec_, mesh.surface_index);
        });
    const auto opaque_count = static_cast<std::size_t>(translucent - sorted.begin());
    ISOSCOPE_RETURN_IF_ERROR(pass_.Add(std::span(sorted).first(opaque_count)));
    return layer_pass_->Add(std::span(sorted).subspan(opaque_count));
  }
  [[nodiscard]] bool is_full() const override { return pass_.is_full(); }
  absl::Status Drain() override { return pass_.Shade(cancellation_); }

 private:
  const frame::FrameSpec& spec_;
  render::RenderPass& pass_;
  render::LayerPass* const layer_pass_;
  const base::Cancellation& cancellation_;
};

}  // namespace

FramePipeline::FramePipeline(Shards shards, ColorVolumes colors, const FrameTask& task,
                             const view::View& view, const AgentResources& resources,
                             const base::Cancellation* cancellation)
    : shards_(std::move(shards)),
      colors_(std::move(colors)),
      task_(task),
      view_(view),
      layout_(shards_.front()->reader->layout()),
      clipper_(task.spec.clip, view.geometry()),
      resources_(resources),
      cancellation_(*cancellation),
      cache_round_(resources.cache->BeginRound(task.frame_number)) {}

// Runs a step. Exceptions (std::bad_alloc) of its parallel loops arrive here.
template <typename Work>
std::invoke_result_t<Work> FramePipeline::RunStep(const char* name, Step step, Step next,
                                                  const Work& work) {
  return OrNoMemoryForStep([&] {
    const base::TraceScope trace(resources_.trace, name);
    const base::ScopedTimer timer(&statistics_.busy_duration);
    ISOSCOPE_CHECK(next_step_ == step);
    next_step_ = next;
    return work();
  });
}

absl::StatusOr<RaySelection> FramePipeline::SelectOccluders() {
  const auto select = [this]() -> absl::StatusOr<RaySelection> {
    absl::StatusOr<std::vector<volume::BlockId>> hits;
    ISOSCOPE_RETURN_IF_ERROR(FindBlocksWhile([&] {
      hits = CastRays(*shards_.front()->reader, view_, clipper_, task_, cancellation_,
                      resources_.trace);
    }));
    ISOSCOPE_RETURN_IF_ERROR(hits.status());
    return RaySelection{*std::move(hits), std::move(reported_)};
  };
  return RunStep("select occluders", Step::kFirst, Step::kRenderOccluders, select);
}

absl::StatusOr<image::FrameImage> FramePipeline::RenderOccluders(
    const std::vector<volume::BlockId>& blocks) {
  const auto draw = [&]() -> absl::StatusOr<image::FrameImage> {
    statistics_.occluding_block_count = static_cast<std::int64_t>(blocks.size());
    ISOSCOPE_ASSIGN_OR_RETURN(std::vector<ChosenMesh> chosen, blocks_->Choose(blocks));
    if (frame::HasLayers(task_.spec)) {
      occluding_ = blocks;
      std::erase_if(chosen, [this](const ChosenMesh& mesh) {
        return IsTranslucent(task_.spec, mesh.surface_index);
      });
    }
    LeaveOutCounted(&chosen);
    return DrawWithCaps(chosen, blocks.size(), frame::Culling::kDepth);
  };
  return RunStep("render occluders", Step::kRenderOccluders, Step::kRenderVisible, draw);
}

absl::StatusOr<image::FrameImage> FramePipeline::RenderVisible(
    const std::vector<volume::BlockId>& blocks, absl::string_view open_pixels) {
  const auto draw = [&]() -> absl::StatusOr<image::FrameImage> {
    std::vector<image::PixelMask> masks;
    if (!open_pixels.empty()) {
      const std::vector<view::PixelRect> rects = RectsOf(blocks, view_, layout_, resources_.arena);
      ISOSCOPE_ASSIGN_OR_RETURN(masks, base::RunIn(resources_.arena, [&] {
                                  return visibility::DecodeOpenPixels(open_pixels, rects);
                                }));
    }
    std::size_t new_count = 0;
    ISOSCOPE_ASSIGN_OR_RETURN(std::vector<ChosenMesh> chosen,
                              ChooseVisible(blocks, masks, &new_count));
    LeaveOutCounted(&chosen);
    return DrawWithCaps(chosen, new_count, frame::Culling::kMask);
  };
  return RunStep("render visible", Step::kRenderVisible, Step::kNone, draw);
}

absl::StatusOr<image::FrameImage> FramePipeline::RenderAll() {
  const auto draw = [this]() -> absl::StatusOr<image::FrameImage> {
    ISOSCOPE_RETURN_IF_ERROR(FindBlocks());
    return DrawWithCaps(blocks_->ChooseAll(),
                        static_cast<std::size_t>(statistics_.active_block_count),
                        frame::Culling::kNone);
  };
  return RunStep("render all", Step::kFirst, Step::kNone, draw);
}

std::vector<std::string> FramePipeline::Encode(const image::FrameImage& image) {
  const base::TraceScope trace(resources_.trace, "encode");
  const base::ScopedTimer timer(&statistics_.busy_duration);
  return base::RunIn(resources_.arena, [&] {
    std::vector<std::string> bands = composite::EncodePixels(image);
    std::vector<std::string> layer_bands = composite::EncodeLayers(layers_);
    std::move(layer_bands.begin(), layer_bands.end(), std::back_inserter(bands));
    return bands;
  });
}

// Step 0, on this thread, which may wait for a disk while the arena runs `work`.
absl::Status FramePipeline::FindBlocksWhile(const std::function<void()>& work) {
  if (resources_.arena->shares_threads()) {  // another step computes while this one reads
    const absl::Status found = FindBlocks();
    base::RunIn(resources_.arena, work);
    return found;
  }
  tbb::task_group working;
  base::RunIn(resources_.arena, [&] { working.run(work); });
  const auto wait = [&] { base::RunIn(resources_.arena, [&] { working.wait(); }); };
  absl::Status found;
  try {
    found = FindBlocks();
  } catch (...) {
    wait();
    throw;
  }
  wait();
  return found;
}

// Step 0.
absl::Status FramePipeline::FindBlocks() {
  const base::TraceScope trace(resources_.trace, "index");
  IndexCost cost;
  ISOSCOPE_ASSIGN_OR_RETURN(SurfaceBlocks found,
                            SurfaceBlocks::Find(shards_, frame::RulesOf(task_.spec),
                                                resources_.cache, cancellation_, &cost));
  if (task_.report_active_blocks) {
    reported_ = found.Ids();  // with clipped ones: the coordinator keeps the list
  }
  found.EraseOutside(clipper_);
  blocks_ = std::make_unique<const SurfaceBlocks>(std::move(found));
  // By surface: true if its fragments show the length of the gradient.
  std::vector<bool> with_magnitudes;
  for (const frame::Surface& surface : task_.spec.surfaces) {
    with_magnitudes.push_back(task_.spec.sends_map_steps && surface.shows_gradient());
  }
  supply_ = std::make_unique<MeshSupply>(blocks_.get(), cache_round_, resources_, &cancellation_,
                                         std::move(with_magnitudes), colors_);
  statistics_.active_block_count = blocks_->block_count();
  statistics_.index_page_read_count += cost.page_read_count;
  statistics_.read_bytes += cost.read_bytes;
  if (resources_.metrics != nullptr) {
    resources_.metrics->active_lookups.hits.Add(cost.kept_list_count);
    resources_.metrics->active_lookups.misses.Add(cost.queried_list_count);
    resources_.metrics->read_bytes.Add(cost.read_bytes);
  }
  return absl::OkStatus();
}

std::vector<volume::BlockId> FramePipeline::HiddenBlocks(const volume::BlockSet& drawn) const {
  std::vector<volume::BlockId> hidden = blocks_->Ids();
  std::erase_if(hidden, [&](volume::BlockId id) { return drawn.Contains(id); });
  return hidden;
}

// Returns the meshes of step 3 in `blocks`: without the opaque ones that step 2 drew.
//
// masks:     open pixels of each block; empty: all are open
// new_count: set to the number of blocks that step 2 did not draw
absl::StatusOr<std::vector<ChosenMesh>> FramePipeline::ChooseVisible(
    const std::vector<volume::BlockId>& blocks, const std::vector<image::PixelMask>& masks,
    std::size_t* new_count) const {
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<ChosenMesh> chosen, blocks_->Choose(blocks));
  *new_count = blocks.size();
  if (!occluding_.empty()) {
    const auto was_drawn = [this](volume::BlockId id) {
      return std::binary_search(occluding_.begin(), occluding_.end(), id);
    };
    std::erase_if(chosen, [&](const ChosenMesh& mesh) {
      return !IsTranslucent(task_.spec, mesh.surface_index) && was_drawn(mesh.block_id);
    });
    *new_count -= static_cast<std::size_t>(std::count_if(blocks.begin(), blocks.end(), was_drawn));
  }
  if (!masks.empty()) {
    for (ChosenMesh& mesh : chosen) {
      const auto found = std::lower_bound(blocks.begin(), blocks.end(), mesh.block_id);
      mesh.open = &masks[static_cast<std::size_t>(found - blocks.begin())];
    }
  }
  return chosen;
}

// Meshes that an earlier band of the picture has counted do not count again.
void FramePipeline::LeaveOutCounted(std::vector<ChosenMesh>* chosen) const {
  if (task_.counted_blocks.empty() && task_.counted_layer_blocks.empty()) {
    return;
  }
  for (ChosenMesh& mesh : *chosen) {
    const std::vector<volume::BlockId>& counted = IsTranslucent(task_.spec, mesh.surface_index)
                                                      ? task_.counted_layer_blocks
                                                      : task_.counted_blocks;
    mesh.counts = !std::binary_search(counted.begin(), counted.end(), mesh.block_id);
  }
}

// Steps 2 and 3: draws the chosen meshes, of `block_count` blocks, in one pass.
absl::StatusOr<image::FrameImage> FramePipeline::Draw(const std::vector<ChosenMesh>& chosen,
                                                      std::size_t block_count) {
  ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
  statistics_.visible_block_count += static_cast<std::int64_t>(block_count);
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::unique_ptr<render::RenderPass> pass,
      RendererOf(task_.spec, resources_).BeginPass(view_, layout_, task_.spec));
  std::optional<render::LayerPass> layer_pass;
  if (frame::HasLayers(task_.spec)) {
    layer_pass.emplace(view_, layout_, task_.spec, resources_.layers);
  }
  PassSink sink(task_.spec, pass.get(), layer_pass ? &*layer_pass : nullptr, cancellation_);
  ISOSCOPE_ASSIGN_OR_RETURN(const SupplyCost cost, supply_->AddMeshes(chosen, &sink));
  frame::AddTo(cost.surfaces, &statistics_.surfaces);
  for (const frame::SurfaceStatistics& surface : cost.surfaces) {
    statistics_.triangle_count += surface.triangle_count;
    statistics_.unique_vertex_count += surface.unique_vertex_count;
  }
  statistics_.read_bytes += cost.read_bytes;
  statistics_.extract_duration += cost.extract_duration;
  statistics_.render_duration += cost.add_duration;
  const base::TraceScope trace(resources_.trace, "shade");
  const base::ScopedTimer timer(&statistics_.render_duration);
  layers_ = layer_pass ? layer_pass->Finish() : image::LayerStack();
  return pass->Finish(cancellation_);
}

// Draws, and adds the caps if they belong to this step, the step of frames with the given culling.
// Caps occlude the blocks behind them. The 1-bit mask has no depth, so with it they come last.
absl::StatusOr<image::FrameImage> FramePipeline::DrawWithCaps(const std::vector<ChosenMesh>& chosen,
                                                              std::size_t block_count,
                                                              frame::Culling cap_culling) {
  absl::StatusOr<image::FrameImage> image = Draw(chosen, block_count);
  if (!image.ok() || !task_.spec.caps.has_value() || task_.spec.culling != cap_culling) {
    return image;
  }
  const base::TraceScope trace(resources_.trace, "caps");
  const base::ScopedTimer timer(&statistics_.render_duration);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t read_bytes,
                            DrawCaps(shards_, colors_, view_, task_.spec,
                                     RendererOf(task_.spec, resources_).picture_revision().back_end,
                                     resources_, cancellation_, &*image));
  statistics_.read_bytes += read_bytes;
  if (resources_.metrics != nullptr) {
    resources_.metrics->read_bytes.Add(read_bytes);
  }
  return image;
}

absl::StatusOr<std::unique_ptr<FramePipeline>> FramePipeline::Make(
    Shards shards, const FrameTask& task, const AgentResources& resources,
    const base::Cancellation* cancellation, const std::vector<Shards>& color_shards) {
  ISOSCOPE_CHECK(!shards.empty());
  const store::ShardReader& first = *shards.front()->reader;
  for (const std::shared_ptr<const Shard>& shard : shards) {
    ISOSCOPE_CHECK_EQ(shard->reader->manifest().dataset_id, first.manifest().dataset_id);
  }
  ISOSCOPE_RETURN_IF_ERROR(
      frame::CheckOwners(frame::OwnerSurfaceCount(task.spec), first.layout().block_count()));
  if (!task.spec.camera.has_value()) {
    return absl::InvalidArgumentError("the frame has no camera; the coordinator must resolve it");
  }
  if (frame::HasSampleCaps(task.spec) && !task.spec.caps->range.has_value()) {
    return absl::InvalidArgumentError(
        "the map of the caps has no range; the coordinator must resolve it");
  }
  const volume::GridGeometry& grid = first.manifest().geometry;
  ISOSCOPE_ASSIGN_OR_RETURN(view::View view,
                            view::View::Make(*task.spec.camera, task.spec.viewport,
                                             task.whole.value_or(grid), task.spec.region));
  if (task.whole.has_value()) {
    ISOSCOPE_ASSIGN_OR_RETURN(view, view.OnGrid(grid));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(ColorVolumes colors, ColorsOf(task.spec, shards, color_shards));
  return std::unique_ptr<FramePipeline>(
      new FramePipeline(std::move(shards), std::move(colors), task, view, resources, cancellation));
}

}  // namespace isoscope::agent
