#include "core/view/clip_region.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/math/matrix.h"

namespace isoscope::view {
namespace {

// A bound of the relative error of the few sums and products of DistanceOf, with much room.
constexpr double kRelativeMargin = 1e-12;

}  // namespace

Clipper::Clipper(const ClipRegion& region, const volume::GridGeometry& geometry) {
  std::vector<HalfSpace> in_world = region.half_spaces;
  if (region.box) {
    for (int axis = 0; axis < 3; ++axis) {
      HalfSpace lower;
      lower.normal[axis] = 1;
      lower.offset = region.box->min[axis];
      HalfSpace upper;
      upper.normal[axis] = -1;
      upper.offset = -region.box->max[axis];
      in_world.push_back(lower);
      in_world.push_back(upper);
    }
  }
  // world = world_from_index * index: the normal of index space is the transposed matrix times the
  // normal of world space.
  const math::Mat4d world_from_index = geometry.world_from_index();
  const math::Vec3d origin = math::TransformPoint(world_from_index, {0, 0, 0});
  for (const HalfSpace& world : in_world) {
    HalfSpace index;
    double magnitude = std::abs(world.offset);
    for (int axis = 0; axis < 3; ++axis) {
      math::Vec3d unit;
      unit[axis] = 1;
      index.normal[axis] = math::Dot(world.normal, math::TransformVector(world_from_index, unit));
      magnitude += std::abs(index.normal[axis]) * static_cast<double>(geometry.sample_dims[axis]) +
                   std::abs(world.normal[axis] * origin[axis]);
    }
    index.offset = world.offset - math::Dot(world.normal, origin);
    half_spaces_.push_back(index);
    margins_.push_back(magnitude * kRelativeMargin);
  }
}

Clipper::Side Clipper::SideOf(const volume::BlockLayout& layout, volume::BlockId id) const {
  return SideOf(layout.CellsOf(id));
}

Clipper::Side Clipper::SideOf(const math::IndexBox& cells) const {
  Side side = Side::kInside;
  for (std::size_t i = 0; i < half_spaces_.size(); ++i) {
    const HalfSpace& half_space = half_spaces_[i];
    // The vertices of a block's triangles lie in its closed box of samples.
    double least = -half_space.offset;
    double greatest = -half_space.offset;
    for (int axis = 0; axis < 3; ++axis) {
      const double a = half_space.normal[axis] * static_cast<double>(cells.begin[axis]);
      const double b = half_space.normal[axis] * static_cast<double>(cells.end[axis]);
      least += std::min(a, b);
      greatest += std::max(a, b);
    }
    if (greatest < -margins_[i]) {
      return Side::kOutside;
    }
    if (!(least > margins_[i])) {
      side = Side::kCut;
    }
  }
  return side;
}

void Clipper::EraseOutside(const volume::BlockLayout& layout, volume::BlockSet* blocks) const {
  if (empty()) {
    return;
  }
  const math::Index3 dims = layout.block_dims();
  // Rounding is monotonic, so the side of a row or a slab is that of all its blocks unless it is
  // cut.
  const auto side_of = [&](std::int64_t first, std::int64_t last) {
    return SideOf({layout.CellsOf(static_cast<volume::BlockId>(first)).begin,
                   layout.CellsOf(static_cast<volume::BlockId>(last)).end});
  };
  const std::int64_t slab = dims.x * dims.y;
  for (std::int64_t begin = 0; begin < slab * dims.z; begin += slab) {
    const Side slab_side = side_of(begin, begin + slab - 1);
    if (slab_side == Side::kOutside) {
      blocks->EraseRange(begin, begin + slab);
    }
    if (slab_side != Side::kCut) {
      continue;
    }
    for (std::int64_t row = begin; row < begin + slab; row += dims.x) {
      const Side row_side = side_of(row, row + dims.x - 1);
      if (row_side == Side::kOutside) {
        blocks->EraseRange(row, row + dims.x);
      }
      if (row_side != Side::kCut) {
        continue;
      }
      for (std::int64_t id = row; id < row + dims.x; ++id) {
        const auto block = static_cast<volume::BlockId>(id);
        if (blocks->Contains(block) && SideOf(layout, block) == Side::kOutside) {
          blocks->EraseRange(id, id + 1);
        }
      }
    }
  }
}

}  // namespace isoscope::view
