#include "partition-agent/supply/block_bounds.h"

#include <algorithm>
#include <cstdint>
#include <vector>

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/view/clip_region.h"
#include "core/visibility/occluder_selection.h"
#include "core/volume/block_set.h"
#include "core/volume/inside_rule.h"

namespace isoscope::agent {
namespace {

volume::BlockId BeginOfPart(std::int64_t block_count, int part_index, int part_count) {
  return static_cast<volume::BlockId>(block_count * part_index / part_count);
}

// Returns a set whose members in [begin, end) are the blocks with a sample inside of one of the
// solids, and the neighbours of such blocks.
volume::BlockSet BlocksNearInside(const volume::BlockLayout& layout,
                                  const volume::RangeTable& ranges,
                                  const std::vector<volume::InsideRule>& solids,
                                  volume::BlockId begin, volume::BlockId end) {
  volume::BlockSet with_inside(ranges.block_count());
  // The ids of neighbours are at most so far away.
  const math::Index3& dims = layout.block_dims();
  const std::int64_t reach = dims.x * dims.y + dims.x + 1;
  const std::int64_t last = std::min(end + reach, ranges.block_count());
  for (std::int64_t i = std::max<std::int64_t>(begin - reach, 0); i < last; ++i) {
    const auto id = static_cast<volume::BlockId>(i);
    const volume::ScalarSpan span = ranges.Get(id);
    if (std::any_of(solids.begin(), solids.end(),
                    [&](const volume::InsideRule& solid) { return solid.MayHaveInside(span); })) {
      with_inside.Insert(id);
    }
  }
  visibility::AddNeighbours(dims, &with_inside);
  return with_inside;
}

}  // namespace

absl::StatusOr<visibility::DepthBounds> BoundsOfPart(const volume::BlockLayout& layout,
                                                     const volume::RangeTable& ranges,
                                                     const view::View& view,
                                                     const frame::FrameSpec& spec,
                                                     const BlockPart& part, base::TaskArena* arena,
                                                     const base::Cancellation& cancellation) {
  ISOSCOPE_CHECK_EQ(layout.block_count(), ranges.block_count());
  const view::Viewport size = view.image_size();
  visibility::DepthBounds bounds(size.width_px, size.height_px);
  const view::Clipper clipper(spec.clip, view.geometry());
  visibility::BoundedBlocks blocks{
      .view = &view,
      .layout = &layout,
      .clipper = &clipper,
      .begin = BeginOfPart(layout.block_count(), part.part_index, part.part_count),
      .end = BeginOfPart(layout.block_count(), part.part_index + 1, part.part_count)};

  // 1. Triangles.
  volume::BlockSet active(layout.block_count());
  for (const frame::Surface& surface : spec.surfaces) {
    active.UnionWith(ranges.ActiveBlocks(surface.rule));
  }
  ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
  blocks.blocks = &active;
  base::RunIn(arena, [&] { visibility::AddSurfaceBlocks(blocks, &bounds); });
  if (!spec.caps.has_value()) {
    return bounds;
  }

  // 2. Caps.
  std::vector<volume::InsideRule> solids;
  for (const frame::Surface& surface : spec.surfaces) {
    if (!surface.is_translucent()) {
      solids.push_back(surface.rule);
    }
  }
  const volume::BlockSet near_inside =
      BlocksNearInside(layout, ranges, solids, blocks.begin, blocks.end);
  ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
  blocks.blocks = &near_inside;
  base::RunIn(arena, [&] { visibility::AddCapBlocks(blocks, &bounds); });
  return bounds;
}

}  // namespace isoscope::agent
