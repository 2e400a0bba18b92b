#include "core/store/block_order.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>

namespace isoscope::store {
namespace {

constexpr int kPlaces = 64;

// x, y and z of each place on the curve; docs/format/shard.md has the same.
constexpr std::array<std::array<std::uint8_t, 3>, kPlaces> kCurve = {{
    {0, 0, 0}, {0, 1, 0}, {1, 1, 0}, {1, 0, 0}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}, {0, 0, 1},
    {0, 0, 2}, {0, 0, 3}, {1, 0, 3}, {1, 0, 2}, {1, 1, 2}, {1, 1, 3}, {0, 1, 3}, {0, 1, 2},
    {0, 2, 2}, {0, 2, 3}, {0, 3, 3}, {0, 3, 2}, {1, 3, 2}, {1, 3, 3}, {1, 2, 3}, {1, 2, 2},
    {1, 2, 1}, {0, 2, 1}, {0, 3, 1}, {1, 3, 1}, {1, 3, 0}, {0, 3, 0}, {0, 2, 0}, {1, 2, 0},
    {2, 2, 0}, {3, 2, 0}, {3, 3, 0}, {2, 3, 0}, {2, 3, 1}, {3, 3, 1}, {3, 2, 1}, {2, 2, 1},
    {2, 2, 2}, {2, 2, 3}, {2, 3, 3}, {2, 3, 2}, {3, 3, 2}, {3, 3, 3}, {3, 2, 3}, {3, 2, 2},
    {3, 1, 2}, {3, 1, 3}, {2, 1, 3}, {2, 1, 2}, {2, 0, 2}, {2, 0, 3}, {3, 0, 3}, {3, 0, 2},
    {3, 0, 1}, {3, 1, 1}, {2, 1, 1}, {2, 0, 1}, {2, 0, 0}, {2, 1, 0}, {3, 1, 0}, {3, 0, 0},
}};

// places[axis][k]: the places, as bits, whose block is below k on the axis.
struct PlacesBelow {
  std::array<std::array<std::uint64_t, kCubeEdge + 1>, 3> places{};
};
constexpr PlacesBelow MakePlacesBelow() {
  PlacesBelow below;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (std::size_t place = 0; place < kPlaces; ++place) {
      for (std::size_t k = kCurve[place][axis] + std::size_t{1}; k <= kCubeEdge; ++k) {
        below.places[axis][k] |= std::uint64_t{1} << place;
      }
    }
  }
  return below;
}
constexpr PlacesBelow kBelow = MakePlacesBelow();

using PlaceTable =
    std::array<std::array<std::array<std::uint8_t, kCubeEdge>, kCubeEdge>, kCubeEdge>;
constexpr PlaceTable MakePlaceTable() {
  PlaceTable table{};
  for (std::size_t place = 0; place < kPlaces; ++place) {
    const auto& at = kCurve[place];
    table[at[2]][at[1]][at[0]] = static_cast<std::uint8_t>(place);
  }
  return table;
}
constexpr PlaceTable kPlaceOf = MakePlaceTable();  // [z][y][x]

constexpr std::int64_t CubeBegin(std::int64_t i) { return i / kCubeEdge * kCubeEdge; }

math::Index3 CubeBegin(const math::Index3& index) {
  return {CubeBegin(index.x), CubeBegin(index.y), CubeBegin(index.z)};
}

// The place of a block in its cube.
int PlaceOf(const math::Index3& index) {
  const math::Index3 at = index - CubeBegin(index);
  return kPlaceOf[static_cast<std::size_t>(at.z)][static_cast<std::size_t>(at.y)]
                 [static_cast<std::size_t>(at.x)];
}

// The places, as bits, of those blocks of the cube that lie in the box.
std::uint64_t PlacesInBox(const math::IndexBox& box, const math::Index3& cube) {
  std::uint64_t places = ~std::uint64_t{0};
  for (int axis = 0; axis < 3; ++axis) {
    const auto& below = kBelow.places[static_cast<std::size_t>(axis)];
    const auto bound = [&](const math::Index3& of) {
      return static_cast<std::size_t>(
          std::clamp(of[axis] - cube[axis], std::int64_t{0}, kCubeEdge));
    };
    places &= below[bound(box.end)] & ~below[bound(box.begin)];
  }
  return places;
}

}  // namespace

std::uint64_t BlockOrderKey(const volume::BlockLayout& layout, volume::BlockId id) {
  const math::Index3 index = layout.IndexOf(id);
  const auto cubes = [](std::int64_t blocks) { return (blocks + kCubeEdge - 1) / kCubeEdge; };
  const math::Index3& dims = layout.block_dims();
  const std::int64_t cube =
      (index.z / kCubeEdge * cubes(dims.y) + index.y / kCubeEdge) * cubes(dims.x) +
      index.x / kCubeEdge;
  return static_cast<std::uint64_t>(cube) * kPlaces + static_cast<std::uint64_t>(PlaceOf(index));
}

std::int64_t RankInBox(const math::IndexBox& box, const math::Index3& index) {
  const math::Index3 cube = CubeBegin(index);
  const math::Index3 begin{std::max(cube.x, box.begin.x), std::max(cube.y, box.begin.y),
                           std::max(cube.z, box.begin.z)};
  const math::Index3 dims = box.dims();
  const std::int64_t layers = std::min(cube.z + kCubeEdge, box.end.z) - begin.z;
  const std::int64_t rows = std::min(cube.y + kCubeEdge, box.end.y) - begin.y;
  const std::uint64_t before = PlacesInBox(box, cube) & ((std::uint64_t{1} << PlaceOf(index)) - 1);
  return (begin.z - box.begin.z) * dims.y * dims.x + (begin.y - box.begin.y) * layers * dims.x +
         (begin.x - box.begin.x) * layers * rows + std::popcount(before);
}

BlocksInOrder::BlocksInOrder(const math::IndexBox& box)
    : box_(box), cube_(CubeBegin(box.begin)), places_(PlacesInBox(box, cube_)) {}

math::Index3 BlocksInOrder::index() const {
  const auto& at = kCurve[static_cast<std::size_t>(std::countr_zero(places_))];
  return cube_ + math::Index3{at[0], at[1], at[2]};
}

void BlocksInOrder::Next() {
  places_ &= places_ - 1;
  if (places_ != 0) {
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
  places_ = PlacesInBox(box_, cube_);
}

}  // namespace isoscope::store
