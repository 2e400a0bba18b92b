#include "server/frame/reduction.h"

#include <algorithm>
#include <bit>
#include <iterator>
#include <new>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/types/span.h"
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/composite/depth_composite.h"
#include "core/visibility/occluder_selection.h"
#include "core/visibility/open_pixels.h"

namespace isoscope::server {
namespace {

// One task tests this many blocks, in some hundred microseconds.
constexpr std::size_t kBlocksPerTask = 512;

absl::Status NoMemoryForLayers() {
  return absl::ResourceExhaustedError("the coordinator has no memory for more layers");
}

}  // namespace

Reduction::Reduction(const ReductionSetup& setup, std::size_t part_count, image::FrameImage image)
    : setup_(setup),
      order_{.block_count = static_cast<std::uint32_t>(setup.layout->block_count()),
             .ties = setup.ties},
      clipper_(setup.spec->clip, setup.view->geometry()),
      has_layers_(frame::HasLayers(*setup.spec)),
      hits_(is_by_trees() ? 0 : setup.layout->block_count()),
      reported_(part_count),
      blocks_(part_count),
      reduced_{.image = std::move(image), .layers = {}, .active = nullptr},
      row_locks_(setup.view->image_size().height_px) {
  if (has_layers_) {
    reduced_.layers =
        image::LayerStack(reduced_.image.width, reduced_.image.height, setup.spec->max_layers + 1,
                          {.block_count = order_.block_count}, setup.images);
  }
}

void Reduction::AddRayHits(std::size_t part_index, const std::vector<volume::BlockId>& hits,
                           std::vector<volume::BlockId> active) {
  if (is_by_trees()) {
    hit_ids_.insert(hit_ids_.end(), hits.begin(), hits.end());
  } else {
    hits_.InsertAll(hits);
  }
  if (setup_.active == nullptr) {
    reported_[part_index] = std::move(active);
  }
}

volume::BlockSet Reduction::ray_hits() const {
  return is_by_trees() ? volume::BlockSet(setup_.layout->block_count(), hit_ids_) : hits_;
}

void Reduction::Prepare() {
  if (setup_.active != nullptr && setup_.active->tree == nullptr) {
    FindFootprints(*setup_.active);
  }
}

// Blocks that are wholly clipped have an empty footprint, and so are never drawn.
void Reduction::FindFootprints(const ActiveBlocks& active) {
  const base::TraceScope trace(setup_.trace, "footprints");
  footprints_.resize(active.ids.size());
  const auto find = [&](const tbb::blocked_range<std::size_t>& range) {
    setup_.view->FootprintsOf(*setup_.layout,
                              absl::MakeSpan(active.ids).subspan(range.begin(), range.size()),
                              absl::MakeSpan(footprints_).subspan(range.begin(), range.size()));
    if (clipper_.empty()) {
      return;
    }
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      if (clipper_.SideOf(*setup_.layout, active.ids[i]) == view::Clipper::Side::kOutside) {
        footprints_[i].rect = {};
      }
    }
  };
  base::RunIn(setup_.arena, [&] {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, active.ids.size(), kBlocksPerTask), find);
  });
}

// Calls select(begin, end, selection to add to) for every run of active blocks, in parallel, and
// joins the selections of each part in order.
template <typename Fn>
std::vector<Reduction::Selection> Reduction::SelectBlocks(const Fn& select) const {
  const std::vector<std::size_t>& begins = reduced_.active->begin_by_agent;
  struct Task {
    std::size_t part_index = 0;
    std::size_t begin = 0;
    std::size_t end = 0;
    Selection selection;
  };
  std::vector<Task> tasks;
  for (std::size_t i = 0; i < blocks_.size(); ++i) {
    for (std::size_t begin = begins[i]; begin < begins[i + 1]; begin += kBlocksPerTask) {
      tasks.push_back({i, begin, std::min(begin + kBlocksPerTask, begins[i + 1]), {}});
    }
  }
  base::RunIn(setup_.arena, [&] {
    tbb::parallel_for(std::size_t{0}, tasks.size(), [&](std::size_t index) {
      Task& task = tasks[index];
      select(task.begin, task.end, &task.selection);
    });
  });
  std::vector<Selection> selections(blocks_.size());
  for (Task& task : tasks) {
    Selection& of_part = selections[task.part_index];
    Selection& of_task = task.selection;
    of_part.blocks.insert(of_part.blocks.end(), of_task.blocks.begin(), of_task.blocks.end());
    std::move(of_task.open.begin(), of_task.open.end(), std::back_inserter(of_part.open));
  }
  return selections;
}

// Calls fn(part index) for every part, in parallel: one message is encoded while others are sent.
// Isolated: this thread must not draw for an agent of this process that has its message already.
template <typename Fn>
void Reduction::ForEachPart(const Fn& fn) const {
  base::RunIn(setup_.arena, [&] {
    tbb::this_task_arena::isolate([&] { tbb::parallel_for(std::size_t{0}, blocks_.size(), fn); });
  });
}

std::vector<volume::BlockId> Reduction::MarkedBlocks(
    const std::vector<std::uint64_t>& marks, std::size_t begin, std::size_t end,
    std::vector<view::Footprint>* footprints) const {
  const ActiveBlocks& active = *reduced_.active;
  std::vector<volume::BlockId> ids;
  for (std::size_t i = begin; i < end; ++i) {
    if (active.tree->IsMarked(marks, i)) {
      ids.push_back(active.ids[i]);
    }
  }
  footprints->resize(ids.size());
  setup_.view->FootprintsOf(*setup_.layout, ids, absl::MakeSpan(*footprints));
  return ids;
}

std::vector<Reduction::Selection> Reduction::OccludersInSet() {
  const ActiveBlocks& active = *reduced_.active;
  reduced_.ray_hit_block_count = hits_.Count();
  occluding_ = visibility::OccludingBlocks(hits_, *setup_.layout, active.set);
  if (footprints_.empty()) {
    FindFootprints(active);
  }
  return SelectBlocks([&](std::size_t begin, std::size_t end, Selection* part) {
    for (std::size_t i = begin; i < end; ++i) {
      if (occluding_.Contains(active.ids[i]) && !footprints_[i].rect.empty()) {
        part->blocks.push_back(active.ids[i]);
      }
    }
  });
}

std::vector<Reduction::Selection> Reduction::OccludersInTree() {
  const ActiveTree& tree = *reduced_.active->tree;
  const std::vector<std::uint64_t> hits = tree.MarksOf(hit_ids_);
  reduced_.ray_hit_block_count = 0;
  for (const std::uint64_t word : hits) {
    reduced_.ray_hit_block_count += std::popcount(word);
  }
  occluding_marks_ = tree.blocks.WithNeighbours(hits);
  return SelectBlocks([&](std::size_t begin, std::size_t end, Selection* part) {
    std::vector<view::Footprint> footprints;
    const std::vector<volume::BlockId> ids =
        MarkedBlocks(occluding_marks_, begin, end, &footprints);
    for (std::size_t i = 0; i < ids.size(); ++i) {
      const bool is_clipped = !clipper_.empty() && clipper_.SideOf(*setup_.layout, ids[i]) ==
                                                       view::Clipper::Side::kOutside;
      if (!is_clipped && !footprints[i].rect.empty()) {
        part->blocks.push_back(ids[i]);
      }
    }
  });
}

void Reduction::SelectOccluders(const PartReady& ready) {
  reduced_.active = setup_.active != nullptr
                        ? setup_.active
                        : std::make_shared<const ActiveBlocks>(reported_, *setup_.layout,
                                                               setup_.max_dense_blocks);
  const base::TraceScope trace(setup_.trace, "find occluders");
  std::vector<Selection> selections =
      reduced_.active->tree != nullptr ? OccludersInTree() : OccludersInSet();
  ForEachPart([&](std::size_t i) {
    blocks_[i].occluders = std::move(selections[i].blocks);
    ready(i, &blocks_[i]);
  });
}

std::vector<Reduction::Selection> Reduction::VisibleInSet(
    const visibility::OcclusionMap& map) const {
  const ActiveBlocks& active = *reduced_.active;
  return SelectBlocks([&](std::size_t begin, std::size_t end, Selection* part) {
    for (std::size_t i = begin; i < end; ++i) {
      const view::Footprint& footprint = footprints_[i];
      const bool is_drawn = !has_layers_ && occluding_.Contains(active.ids[i]);
      if (is_drawn || footprint.rect.empty() || map.Hides(footprint)) {
        continue;
      }
      part->blocks.push_back(active.ids[i]);
      // The 1-bit mask is the paper's: it culls blocks, not fragments.
      if (has_depth()) {
        part->open.push_back(map.OpenPixels(footprint));
      }
    }
  });
}

std::vector<Reduction::Selection> Reduction::VisibleInTree(
    const visibility::OcclusionMap& map) const {
  const absl::Span<const std::uint64_t> drawn =
      has_layers_ ? absl::Span<const std::uint64_t>() : occluding_marks_;
  std::vector<std::uint64_t> open;
  base::RunIn(setup_.arena, [&] {
    open =
        reduced_.active->tree->cubes.OpenBlocks(*setup_.view, *setup_.layout, clipper_, map, drawn);
  });
  return SelectBlocks([&](std::size_t begin, std::size_t end, Selection* part) {
    std::vector<view::Footprint> footprints;
    part->blocks = MarkedBlocks(open, begin, end, &footprints);
    if (has_depth()) {
      for (const view::Footprint& footprint : footprints) {
        part->open.push_back(map.OpenPixels(footprint));
      }
    }
  });
}

void Reduction::SelectVisible(const PartReady& ready) {
  const base::TraceScope trace(setup_.trace, "cull");
  const visibility::OcclusionMap map = base::RunIn(setup_.arena, [&] {
    return visibility::OcclusionMap::FromImage(
        reduced_.image, has_depth() ? visibility::MapKind::kDepth : visibility::MapKind::kMask);
  });
  std::vector<Selection> selections =
      reduced_.active->tree != nullptr ? VisibleInTree(map) : VisibleInSet(map);
  ForEachPart([&](std::size_t i) {
    blocks_[i].visible = std::move(selections[i].blocks);
    if (has_depth()) {
      blocks_[i].open_pixels = visibility::EncodeOpenPixels(selections[i].open);
    }
    ready(i, &blocks_[i]);
  });
}

ReducedFrame Reduction::Take() {
  if (setup_.keeps_blocks && reduced_.active != nullptr) {
    for (PartBlocks& part : blocks_) {
      part.open_pixels = {};
    }
    reduced_.blocks = std::move(blocks_);
    reduced_.ray_hits = is_by_trees() ? ray_hits() : std::move(hits_);
  }
  return std::move(reduced_);
}

absl::Status Reduction::CheckSize(const image::DrawnPixels& pixels) const {
  const image::FrameImage& image = reduced_.image;
  if (pixels.image.width == image.width && pixels.image.height == image.height) {
    return absl::OkStatus();
  }
  return absl::InternalError(absl::StrFormat("drew %d x %d pixels of %d x %d", pixels.image.width,
                                             pixels.image.height, image.width, image.height));
}

absl::Status Reduction::CompositeDrawn(const image::DrawnPixels& pixels, bool in_parallel) {
  const auto composite_row = [&](int row) {
    const base::MutexLock lock(&row_locks_.OfTileRow(row));
    composite::CompositeTileRowInto(pixels.image, row, order_, &reduced_.image);
    if (has_layers_) {
      composite::CompositeTileRowInto(pixels.layers, row, &reduced_.layers);
    }
  };
  try {
    const int rows = pixels.image.touched.rows();
    if (in_parallel) {
      tbb::parallel_for(0, rows, composite_row);
    } else {
      for (int row = 0; row < rows; ++row) {
        composite_row(row);
      }
    }
  } catch (const std::bad_alloc&) {
    return NoMemoryForLayers();
  }
  return absl::OkStatus();
}

absl::Status Reduction::CompositeBand(absl::string_view band) {
  const base::TraceScope trace(setup_.trace, "composite");
  const frame::FrameSpec& spec = *setup_.spec;
  const composite::SurfaceCounts surfaces{
      .opaque = spec.sends_normals ? frame::OwnerSurfaceCount(spec) : spec.surfaces.size(),
      .layers = spec.surfaces.size()};
  try {
    return composite::DecodePixelsInto(band, order_, surfaces, &reduced_.image, &row_locks_,
                                       has_layers_ ? &reduced_.layers : nullptr);
  } catch (const std::bad_alloc&) {
    return NoMemoryForLayers();
  }
}

}  // namespace isoscope::server
