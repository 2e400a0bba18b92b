// OpenBlocks goes down the cubes level by level, so that each level is tested in parallel:
//
//   1. The cubes of a level are tested, the volume first. A cube is closed if its footprint is empty
//      or hidden, or all of it is clipped. The children with members of the others are next.
//   2. The members of open bricks, the last level, are tested one by one, as in a small volume.
//
// Why the marks are those of a test of each block. A footprint bounds linear functions over a box by
// its corners, and adds margins that grow with the box. So in exact arithmetic a cube's rectangle
// covers that of each block in it, its nearest depth is at most the block's, and it is the whole
// picture if a block's is. Cubes are grown by a cell on each side, which is far more than rounding
// could take away. A map that hides a rectangle at a depth hides each part of it at greater depths.
// Sides of clip regions are monotonic as they are (core/view/clip_region.cc).
// The picture does not rest on this: a cube's footprint, as that of any box, covers all fragments in
// it.

#include "core/visibility/open_blocks.h"

#include <algorithm>
#include <bit>

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/base/check.h"

namespace isoscope::visibility {
namespace {

// One task tests this many cubes, in some ten microseconds.
constexpr std::size_t kCubesPerTask = 256;

std::int64_t HalfUp(std::int64_t value) { return (value + 1) / 2; }

// Returns the cells of a cube, cut off at the volume's border.
math::IndexBox CellsOf(const volume::BlockLayout& layout, std::size_t level,
                       const math::Index3& cube) {
  math::IndexBox cells;
  for (int axis = 0; axis < 3; ++axis) {
    const std::int64_t side = (volume::BlockTree::kBrickSide << level) * layout.block_cells()[axis];
    cells.begin[axis] = cube[axis] * side;
    cells.end[axis] = std::min(cells.begin[axis] + side, layout.sample_dims()[axis] - 1);
  }
  return cells;
}

}  // namespace

BlockCubes::BlockCubes(const volume::BlockTree& blocks) : blocks_(blocks) {
  Level bricks{blocks.brick_dims(), {}};
  bricks.has_members.resize(blocks.cells().size());
  for (const std::uint32_t brick : blocks.bricks()) {
    bricks.has_members[brick] = 1;
  }
  levels_.push_back(std::move(bricks));
  while (math::Volume(levels_.back().dims) > 1) {
    const Level& fine = levels_.back();
    Level coarse{{HalfUp(fine.dims.x), HalfUp(fine.dims.y), HalfUp(fine.dims.z)}, {}};
    coarse.has_members.resize(static_cast<std::size_t>(math::Volume(coarse.dims)));
    std::size_t from = 0;
    for (std::int64_t z = 0; z < fine.dims.z; ++z) {
      for (std::int64_t y = 0; y < fine.dims.y; ++y) {
        char* const row =
            coarse.has_members.data() + coarse.dims.x * (y / 2 + coarse.dims.y * (z / 2));
        for (std::int64_t x = 0; x < fine.dims.x; ++x) {
          row[x / 2] = static_cast<char>(row[x / 2] | fine.has_members[from++]);
        }
      }
    }
    levels_.push_back(std::move(coarse));
  }
}

std::size_t BlockCubes::size_bytes() const {
  std::size_t bytes = sizeof(*this);
  for (const Level& level : levels_) {
    bytes += level.has_members.capacity();
  }
  return bytes;
}

view::Footprint BlockCubes::FootprintOf(const view::View& view, const volume::BlockLayout& layout,
                                        std::size_t level, const math::Index3& cube) {
  const math::IndexBox cells = CellsOf(layout, level, cube);
  math::Vec3d begin;
  math::Vec3d end;
  for (int axis = 0; axis < 3; ++axis) {
    begin[axis] = static_cast<double>(cells.begin[axis] - 1);
    end[axis] = static_cast<double>(cells.end[axis] + 1);
  }
  return view.FootprintOf(begin, end);
}

std::vector<std::uint64_t> BlockCubes::OpenBlocks(const view::View& view,
                                                  const volume::BlockLayout& layout,
                                                  const view::Clipper& clipper,
                                                  const OcclusionMap& map,
                                                  absl::Span<const std::uint64_t> skipped) const {
  const absl::Span<const std::uint64_t> words = blocks_.words();
  ISOSCOPE_CHECK(layout.block_dims() == blocks_.block_dims());
  ISOSCOPE_CHECK(skipped.empty() || skipped.size() == words.size());
  std::vector<std::uint64_t> marks(words.size());
  if (words.empty()) {
    return marks;
  }
  // Step 1: from the volume down to bricks.
  const auto is_closed = [&](std::size_t level, const math::Index3& cube) {
    if (!clipper.empty() &&
        clipper.SideOf(CellsOf(layout, level, cube)) == view::Clipper::Side::kOutside) {
      return true;
    }
    const view::Footprint footprint = FootprintOf(view, layout, level, cube);
    return footprint.rect.empty() || map.Hides(footprint);
  };
  std::vector<math::Index3> cubes{{}};
  for (std::size_t level = levels_.size() - 1;; --level) {
    std::vector<char> closed(cubes.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, cubes.size(), kCubesPerTask),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                        for (std::size_t i = range.begin(); i < range.end(); ++i) {
                          closed[i] = is_closed(level, cubes[i]) ? 1 : 0;
                        }
                      });
    std::vector<math::Index3> next;
    for (std::size_t i = 0; i < cubes.size(); ++i) {
      if (closed[i] != 0) {
        continue;
      }
      if (level == 0) {
        next.push_back(cubes[i]);
        continue;
      }
      const Level& finer = levels_[level - 1];
      const math::Index3 begin{2 * cubes[i].x, 2 * cubes[i].y, 2 * cubes[i].z};
      for (std::int64_t z = begin.z; z < std::min(begin.z + 2, finer.dims.z); ++z) {
        for (std::int64_t y = begin.y; y < std::min(begin.y + 2, finer.dims.y); ++y) {
          for (std::int64_t x = begin.x; x < std::min(begin.x + 2, finer.dims.x); ++x) {
            if (finer.has_members[static_cast<std::size_t>(x + finer.dims.x *
                                                                   (y + finer.dims.y * z))] != 0) {
              next.push_back({x, y, z});
            }
          }
        }
      }
    }
    cubes = std::move(next);
    if (level == 0) {
      break;
    }
  }
  // Step 2: the members of open bricks. Each brick has a word of its own.
  const auto test_brick = [&](const math::Index3& brick) {
    const math::Index3& dims = blocks_.brick_dims();
    const std::int64_t index = brick.x + dims.x * (brick.y + dims.y * brick.z);
    const std::uint32_t cell = blocks_.cells()[static_cast<std::size_t>(index)];
    std::uint64_t rest = words[cell] & (skipped.empty() ? ~std::uint64_t{0} : ~skipped[cell]);
    volume::BlockId ids[64];
    view::Footprint footprints[64];
    int bits[64];
    std::size_t count = 0;
    for (; rest != 0; rest &= rest - 1) {
      bits[count] = std::countr_zero(rest);
      ids[count] = layout.IdOf(blocks_.IndexOf(static_cast<std::uint32_t>(index), bits[count]));
      ++count;
    }
    view.FootprintsOf(layout, absl::MakeConstSpan(ids, count), absl::MakeSpan(footprints, count));
    for (std::size_t i = 0; i < count; ++i) {
      const bool is_clipped =
          !clipper.empty() && clipper.SideOf(layout, ids[i]) == view::Clipper::Side::kOutside;
      if (!is_clipped && !footprints[i].rect.empty() && !map.Hides(footprints[i])) {
        marks[cell] |= std::uint64_t{1} << bits[i];
      }
    }
  };
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, cubes.size(), kCubesPerTask / 8),
                    [&](const tbb::blocked_range<std::size_t>& range) {
                      for (std::size_t i = range.begin(); i < range.end(); ++i) {
                        test_brick(cubes[i]);
                      }
                    });
  return marks;
}

}  // namespace isoscope::visibility
