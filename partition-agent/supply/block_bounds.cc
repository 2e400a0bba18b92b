// Blocks are collected some hundred thousand at a time:
//
// 1. Triangles: the active blocks of each surface, from its set, or from its tree if the volume is
//    large. A block that several surfaces meet is added again, which changes no minimum or maximum.
// 2. Caps: blocks that the region's border cuts. Cubes of blocks that it does not cut are left out
//    as wholes: rounding is monotonic, so no block in them is cut. Of the others, the spans of the
//    block and of its neighbours decide.

#include "partition-agent/supply/block_bounds.h"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/types/span.h"

#include "core/base/status_macros.h"
#include "core/math/box.h"
#include "core/math/vec.h"
#include "core/view/clip_region.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_set.h"
#include "core/volume/block_spans.h"
#include "core/volume/inside_rule.h"
#include "core/volume/span_octree.h"

namespace isoscope::agent {
namespace {

constexpr std::size_t kChunkBlocks = std::size_t{1} << 17;

// Block ids [begin, end).
struct IdRange {
  std::int64_t begin = 0;
  std::int64_t end = 0;

  [[nodiscard]] bool Contains(std::int64_t id) const { return begin <= id && id < end; }
};

IdRange RangeOf(const BlockPart& part, std::int64_t block_count) {
  return {block_count * part.part_index / part.part_count,
          block_count * (part.part_index + 1) / part.part_count};
}

// Collects blocks, and hands them on in chunks.
class Chunks {
 public:
  using Visit = absl::FunctionRef<absl::Status(std::span<const volume::BlockId>)>;

  explicit Chunks(Visit visit) : visit_(visit) {}

  void Add(std::int64_t id) { ids_.push_back(static_cast<volume::BlockId>(id)); }
  // Visits what was added if that is a chunk, or at the end.
  absl::Status Flush(bool is_end) {
    if (ids_.empty() || (!is_end && ids_.size() < kChunkBlocks)) {
      return absl::OkStatus();
    }
    const absl::Status status = visit_(ids_);
    ids_.clear();
    return status;
  }

 private:
  Visit visit_;
  std::vector<volume::BlockId> ids_;
};

// Visits the members in a range.
absl::Status ForEachMember(const volume::BlockSet& blocks, const IdRange& range, Chunks* chunks) {
  const absl::Span<const std::uint64_t> words = blocks.words();
  for (std::int64_t word = range.begin / 64; word * 64 < range.end; ++word) {
    for (std::uint64_t bits = words[static_cast<std::size_t>(word)]; bits != 0; bits &= bits - 1) {
      if (const std::int64_t id = 64 * word + std::countr_zero(bits); range.Contains(id)) {
        chunks->Add(id);
      }
    }
    ISOSCOPE_RETURN_IF_ERROR(chunks->Flush(/*is_end=*/false));
  }
  return chunks->Flush(/*is_end=*/true);
}

absl::Status ForEachMember(const volume::BlockTree& blocks, const volume::BlockLayout& layout,
                           const IdRange& range, Chunks* chunks) {
  // The bricks of the layers in which the range lies.
  const math::Index3& dims = layout.block_dims();
  const std::int64_t layer_bricks = blocks.brick_dims().x * blocks.brick_dims().y;
  const auto first_brick_of = [&](std::int64_t layer) {
    const absl::Span<const std::uint32_t> bricks = blocks.bricks();
    return static_cast<std::size_t>(
        std::lower_bound(bricks.begin(), bricks.end(), layer * layer_bricks) - bricks.begin());
  };
  const std::int64_t blocks_of_layer = dims.x * dims.y * volume::BlockTree::kBrickSide;
  const std::size_t end = first_brick_of((range.end + blocks_of_layer - 1) / blocks_of_layer);
  for (std::size_t i = first_brick_of(range.begin / blocks_of_layer); i < end; ++i) {
    for (std::uint64_t bits = blocks.words()[i]; bits != 0; bits &= bits - 1) {
      const std::int64_t id =
          layout.IdOf(blocks.IndexOf(blocks.bricks()[i], std::countr_zero(bits)));
      if (range.Contains(id)) {
        chunks->Add(id);
      }
    }
    ISOSCOPE_RETURN_IF_ERROR(chunks->Flush(/*is_end=*/false));
  }
  return chunks->Flush(/*is_end=*/true);
}

// Calls fn(index) with each block of a box until it returns false.
template <typename Fn>
bool ForEachBlock(const math::IndexBox& box, const Fn& fn) {
  for (std::int64_t z = box.begin.z; z < box.end.z; ++z) {
    for (std::int64_t y = box.begin.y; y < box.end.y; ++y) {
      for (std::int64_t x = box.begin.x; x < box.end.x; ++x) {
        if (!fn(math::Index3{x, y, z})) {
          return false;
        }
      }
    }
  }
  return true;
}

// Whether the samples of a block or of a neighbour may be inside of a solid.
bool IsNearInside(const volume::BlockLayout& layout, const math::Index3& index,
                  const std::vector<volume::InsideRule>& solids, volume::BlockSpans* spans) {
  math::IndexBox around;
  for (int axis = 0; axis < 3; ++axis) {
    around.begin[axis] = std::max<std::int64_t>(index[axis] - 1, 0);
    around.end[axis] = std::min(index[axis] + 2, layout.block_dims()[axis]);
  }
  return !ForEachBlock(around, [&](const math::Index3& other) {
    const volume::ScalarSpan span = spans->Get(layout.IdOf(other));
    return std::none_of(solids.begin(), solids.end(),
                        [&](const volume::InsideRule& solid) { return solid.MayHaveInside(span); });
  });
}

// Visits the blocks in a range that may have caps, a cube of blocks after the other.
absl::Status ForEachCapBlock(const store::ShardReader& reader, const view::Clipper& clipper,
                             const std::vector<volume::InsideRule>& solids, const IdRange& range,
                             const base::Cancellation& cancellation, Chunks* chunks) {
  const volume::BlockLayout& layout = reader.layout();
  const volume::SpanPageLayout cubes(layout.block_dims());
  constexpr std::int64_t kSide = volume::SpanPageLayout::kPageSide;
  volume::BlockSpans spans = reader.Spans();
  for (std::int64_t cube = 0; cube < cubes.page_count(); ++cube) {
    math::IndexBox box;
    box.begin = cubes.BeginOf(cube);
    for (int axis = 0; axis < 3; ++axis) {
      box.end[axis] = std::min(box.begin[axis] + kSide, layout.block_dims()[axis]);
    }
    const volume::BlockId first = layout.IdOf(box.begin);
    const volume::BlockId last = layout.IdOf(box.end - math::Index3{1, 1, 1});
    if (last < range.begin || first >= range.end ||
        clipper.SideOf({layout.CellsOf(first).begin, layout.CellsOf(last).end}) !=
            view::Clipper::Side::kCut) {
      continue;
    }
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    ForEachBlock(box, [&](const math::Index3& index) {
      const volume::BlockId id = layout.IdOf(index);
      if (range.Contains(id) && clipper.SideOf(layout, id) == view::Clipper::Side::kCut &&
          IsNearInside(layout, index, solids, &spans)) {
        chunks->Add(id);
      }
      return true;
    });
    ISOSCOPE_RETURN_IF_ERROR(spans.status());
    ISOSCOPE_RETURN_IF_ERROR(chunks->Flush(/*is_end=*/false));
  }
  return chunks->Flush(/*is_end=*/true);
}

}  // namespace

absl::StatusOr<visibility::DepthBounds> BoundsOfPart(const store::ShardReader& reader,
                                                     const view::View& view,
                                                     const frame::FrameSpec& spec,
                                                     const BlockPart& part, base::TaskArena* arena,
                                                     const base::Cancellation& cancellation,
                                                     std::int64_t max_dense_blocks) {
  const volume::BlockLayout& layout = reader.layout();
  const IdRange range = RangeOf(part, layout.block_count());
  const view::Viewport size = view.image_size();
  visibility::DepthBounds bounds(size.width_px, size.height_px);
  const view::Clipper clipper(spec.clip, view.geometry());
  visibility::BoundedBlocks blocks{
      .view = &view, .layout = &layout, .clipper = &clipper, .ids = {}};

  // 1. Triangles.
  const auto add_surface = [&](std::span<const volume::BlockId> ids) {
    blocks.ids = ids;
    base::RunIn(arena, [&] { visibility::AddSurfaceBlocks(blocks, &bounds); });
    return cancellation.Check();
  };
  for (const frame::Surface& surface : spec.surfaces) {
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    Chunks chunks(add_surface);
    if (layout.block_count() > max_dense_blocks) {
      ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const volume::BlockTree> active,
                                reader.ActiveTree(surface.rule));
      ISOSCOPE_RETURN_IF_ERROR(ForEachMember(*active, layout, range, &chunks));
    } else {
      ISOSCOPE_RETURN_IF_ERROR(ForEachMember(*reader.ActiveBlocks(surface.rule), range, &chunks));
    }
  }
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
  const auto add_caps = [&](std::span<const volume::BlockId> ids) {
    blocks.ids = ids;
    base::RunIn(arena, [&] { visibility::AddCapBlocks(blocks, &bounds); });
    return cancellation.Check();
  };
  Chunks chunks(add_caps);
  ISOSCOPE_RETURN_IF_ERROR(ForEachCapBlock(reader, clipper, solids, range, cancellation, &chunks));
  return bounds;
}

}  // namespace isoscope::agent
