// Blocks are ordered by their cube, then by their curve index, 0 to 63, in the cube:
//
//   key = 64 * cube + curve index,   cube = (z/4 * cubes_y + y/4) * cubes_x + x/4
//
// The blocks of a cube that lie in a box are a 64-bit curve mask: bit i stands for curve index i.
// A table has the masks of the blocks below k, for each axis and k = 0 .. 4. So the mask of a box
// is below[end] & ~below[begin] on each axis, and the AND of the three. The blocks of the box in
// order are its set bits from low to high; the rank of a block is the count of set bits below its
// own.
//
// Example: the box of 3 x 2 x 1 blocks at the origin has the curve indices 0 to 3, 60 and 61: the
// blocks 000, 010, 110, 100, 200, 210 in this order. Block 210 has the mask bits 0-3 and 60 below
// its own: its rank is 5.
//
// RankInBox adds the blocks of the cubes before: layers of cubes, then rows of the layer, then
// cubes of the row, each clipped by the box.

#include "core/store/block_order.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>

namespace isoscope::store {
namespace {

constexpr int kCubeBlocks = 64;

// x, y and z of the block at each curve index; docs/format/shard.md has the same table.
constexpr std::array<std::array<std::uint8_t, 3>, kCubeBlocks> kCurve = {{
    {0, 0, 0}, {0, 1, 0}, {1, 1, 0}, {1, 0, 0}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}, {0, 0, 1},
    {0, 0, 2}, {0, 0, 3}, {1, 0, 3}, {1, 0, 2}, {1, 1, 2}, {1, 1, 3}, {0, 1, 3}, {0, 1, 2},
    {0, 2, 2}, {0, 2, 3}, {0, 3, 3}, {0, 3, 2}, {1, 3, 2}, {1, 3, 3}, {1, 2, 3}, {1, 2, 2},
    {1, 2, 1}, {0, 2, 1}, {0, 3, 1}, {1, 3, 1}, {1, 3, 0}, {0, 3, 0}, {0, 2, 0}, {1, 2, 0},
    {2, 2, 0}, {3, 2, 0}, {3, 3, 0}, {2, 3, 0}, {2, 3, 1}, {3, 3, 1}, {3, 2, 1}, {2, 2, 1},
    {2, 2, 2}, {2, 2, 3}, {2, 3, 3}, {2, 3, 2}, {3, 3, 2}, {3, 3, 3}, {3, 2, 3}, {3, 2, 2},
    {3, 1, 2}, {3, 1, 3}, {2, 1, 3}, {2, 1, 2}, {2, 0, 2}, {2, 0, 3}, {3, 0, 3}, {3, 0, 2},
    {3, 0, 1}, {3, 1, 1}, {2, 1, 1}, {2, 0, 1}, {2, 0, 0}, {2, 1, 0}, {3, 1, 0}, {3, 0, 0},
}};

// masks[axis][k]: curve mask of the blocks that are below k on the axis.
struct CurveMasksBelow {
  std::array<std::array<std::uint64_t, kCubeEdge + 1>, 3> masks{};
};
constexpr CurveMasksBelow MakeCurveMasksBelow() {
  CurveMasksBelow below;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (std::size_t curve_index = 0; curve_index < kCubeBlocks; ++curve_index) {
      for (std::size_t k = kCurve[curve_index][axis] + std::size_t{1}; k <= kCubeEdge; ++k) {
        below.masks[axis][k] |= std::uint64_t{1} << curve_index;
      }
    }
  }
  return below;
}
constexpr CurveMasksBelow kBelow = MakeCurveMasksBelow();

using CurveIndexTable =
    std::array<std::array<std::array<std::uint8_t, kCubeEdge>, kCubeEdge>, kCubeEdge>;
constexpr CurveIndexTable MakeCurveIndexTable() {
  CurveIndexTable table{};
  for (std::size_t curve_index = 0; curve_index < kCubeBlocks; ++curve_index) {
    const auto& at = kCurve[curve_index];
    table[at[2]][at[1]][at[0]] = static_cast<std::uint8_t>(curve_index);
  }
  return table;
}
constexpr CurveIndexTable kCurveIndexOf = MakeCurveIndexTable();  // [z][y][x]

constexpr std::int64_t CubeBegin(std::int64_t i) { return i / kCubeEdge * kCubeEdge; }

math::Index3 CubeBegin(const math::Index3& index) {
  return {CubeBegin(index.x), CubeBegin(index.y), CubeBegin(index.z)};
}

// The curve index of a block in its cube.
int CurveIndexOf(const math::Index3& index) {
  const math::Index3 at = index - CubeBegin(index);
  return kCurveIndexOf[static_cast<std::size_t>(at.z)][static_cast<std::size_t>(at.y)]
                      [static_cast<std::size_t>(at.x)];
}

// The curve mask of the blocks of a cube that lie in the box.
std::uint64_t CurveMaskInBox(const math::IndexBox& box, const math::Index3& cube) {
  std::uint64_t mask = ~std::uint64_t{0};
  for (int axis = 0; axis < 3; ++axis) {
    const auto& below = kBelow.masks[static_cast<std::size_t>(axis)];
    const auto bound = [&](const math::Index3& of) {
      return static_cast<std::size_t>(
          std::clamp(of[axis] - cube[axis], std::int64_t{0}, kCubeEdge));
    };
    mask &= below[bound(box.end)] & ~below[bound(box.begin)];
  }
  return mask;
}

}  // namespace

std::uint64_t BlockOrderKey(const volume::BlockLayout& layout, volume::BlockId id) {
  const math::Index3 index = layout.IndexOf(id);
  const auto cubes = [](std::int64_t blocks) { return (blocks + kCubeEdge - 1) / kCubeEdge; };
  const math::Index3& dims = layout.block_dims();
  const std::int64_t cube =
      (index.z / kCubeEdge * cubes(dims.y) + index.y / kCubeEdge) * cubes(dims.x) +
      index.x / kCubeEdge;
  return static_cast<std::uint64_t>(cube) * kCubeBlocks +
         static_cast<std::uint64_t>(CurveIndexOf(index));
}

std::int64_t RankInBox(const math::IndexBox& box, const math::Index3& index) {
  const math::Index3 cube = CubeBegin(index);
  const math::Index3 begin{std::max(cube.x, box.begin.x), std::max(cube.y, box.begin.y),
                           std::max(cube.z, box.begin.z)};
  const math::Index3 dims = box.dims();
  const std::int64_t layers = std::min(cube.z + kCubeEdge, box.end.z) - begin.z;
  const std::int64_t rows = std::min(cube.y + kCubeEdge, box.end.y) - begin.y;
  const std::uint64_t before =
      CurveMaskInBox(box, cube) & ((std::uint64_t{1} << CurveIndexOf(index)) - 1);
  return (begin.z - box.begin.z) * dims.y * dims.x + (begin.y - box.begin.y) * layers * dims.x +
         (begin.x - box.begin.x) * layers * rows + std::popcount(before);
}

BlocksInOrder::BlocksInOrder(const math::IndexBox& box)
    : box_(box), cube_(CubeBegin(box.begin)), remaining_(CurveMaskInBox(box, cube_)) {}

math::Index3 BlocksInOrder::index() const {
  const auto& at = kCurve[static_cast<std::size_t>(std::countr_zero(remaining_))];
  return cube_ + math::Index3{at[0], at[1], at[2]};
}

void BlocksInOrder::Next() {
  remaining_ &= remaining_ - 1;
  if (remaining_ != 0) {
    return;
  }
  cube_.x += kCubeEdge;
  if (cube_.x >= box_.end.x) {
    cube_.x = CubeBegin(box_.begin.x);
    cube_.y += kCubeEdge;
    if (cube_.y >= box_.end.y) {
      cube_.y = CubeBegin(box_.begin.y);
      cube_.z += kCubeEdge;
    }
  }
  remaining_ = CurveMaskInBox(box_, cube_);
}

}  // namespace isoscope::store
