#include "server/picture/depth_grid.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "core/base/coding.h"
#include "core/view/unprojection.h"

namespace isoscope::server {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();  // the background

// Returns the pixel whose square holds the point (i + 0.5) / count of the side.
int PixelOf(int i, int count, int side) {
  const std::int64_t twice = (2 * std::int64_t{i} + 1) * side;
  return static_cast<int>(std::min<std::int64_t>(twice / (2 * std::int64_t{count}), side - 1));
}

}  // namespace

DepthGrid MakeDepthGrid(const image::FrameImage& image, const view::View& view, int longer_side) {
  const int longer_px = std::max(image.width, image.height);
  const int points = std::min(longer_side, longer_px);
  const auto points_of = [&](int side) {
    return std::max(1, static_cast<int>(std::int64_t{side} * points / longer_px));
  };
  DepthGrid grid{.width = points_of(image.width), .height = points_of(image.height)};
  const view::Unprojection unprojection(view);
  std::vector<float> distances;
  distances.reserve(static_cast<std::size_t>(grid.width) * static_cast<std::size_t>(grid.height));
  bool is_empty = true;
  float least = 0;
  float greatest = 0;
  for (int j = 0; j < grid.height; ++j) {
    const int y = PixelOf(j, grid.height, image.height);
    for (int i = 0; i < grid.width; ++i) {
      const std::uint64_t key = image.keys[image.IndexOf(PixelOf(i, grid.width, image.width), y)];
      if (image::OwnerOf(key) == image::kNoOwner) {
        distances.push_back(kInfinity);
        continue;
      }
      const float distance = unprojection.DistanceOf(image::DepthOf(key));
      distances.push_back(distance);
      least = is_empty ? distance : std::min(least, distance);
      greatest = is_empty ? distance : std::max(greatest, distance);
      is_empty = false;
    }
  }
  grid.near_distance = static_cast<double>(least);
  grid.far_distance = static_cast<double>(greatest);
  const double range = grid.far_distance - grid.near_distance;
  constexpr int kLevels = kGridBackground - 1;
  grid.depths.resize(distances.size() * sizeof(std::uint16_t));
  for (std::size_t i = 0; i < distances.size(); ++i) {
    std::uint16_t value = kGridBackground;
    if (distances[i] != kInfinity) {
      const double share =
          range > 0 ? (static_cast<double>(distances[i]) - grid.near_distance) / range : 0;
      value = static_cast<std::uint16_t>(std::lround(std::clamp(share, 0.0, 1.0) * kLevels));
    }
    base::StoreLittleEndian(value, grid.depths.data() + i * sizeof(value));
  }
  return grid;
}

}  // namespace isoscope::server
