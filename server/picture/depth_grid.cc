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

DepthGridBuilder::DepthGridBuilder(const view::Viewport& picture, int longer_side)
    : picture_(picture) {
  const int longer_px = std::max(picture.width_px, picture.height_px);
  const int points = std::min(longer_side, longer_px);
  const auto points_of = [&](int side) {
    return std::max(1, static_cast<int>(std::int64_t{side} * points / longer_px));
  };
  width_ = points_of(picture.width_px);
  height_ = points_of(picture.height_px);
  distances_.resize(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_),
                    kInfinity);
}

void DepthGridBuilder::Add(const view::Region& band, const image::FrameImage& image,
                           const view::View& view, int margin_x, int margin_y) {
  const view::Unprojection unprojection(view);
  for (int j = 0; j < height_; ++j) {
    const int y = PixelOf(j, height_, picture_.height_px) - band.y;
    if (y < 0 || y >= band.height_px) {
      continue;
    }
    for (int i = 0; i < width_; ++i) {
      const int x = PixelOf(i, width_, picture_.width_px) - band.x;
      if (x < 0 || x >= band.width_px) {
        continue;
      }
      const std::uint64_t key = image.keys[image.IndexOf(margin_x + x, margin_y + y)];
      if (image::OwnerOf(key) != image::kNoOwner) {
        distances_[static_cast<std::size_t>(j) * static_cast<std::size_t>(width_) +
                   static_cast<std::size_t>(i)] = unprojection.DistanceOf(image::DepthOf(key));
      }
    }
  }
}

DepthGrid DepthGridBuilder::Make() const {
  DepthGrid grid{.width = width_, .height = height_};
  bool is_empty = true;
  float least = 0;
  float greatest = 0;
  for (const float distance : distances_) {
    if (distance != kInfinity) {
      least = is_empty ? distance : std::min(least, distance);
      greatest = is_empty ? distance : std::max(greatest, distance);
      is_empty = false;
    }
  }
  grid.near_distance = static_cast<double>(least);
  grid.far_distance = static_cast<double>(greatest);
  const double range = grid.far_distance - grid.near_distance;
  constexpr int kLevels = kGridBackground - 1;
  grid.depths.resize(distances_.size() * sizeof(std::uint16_t));
  for (std::size_t i = 0; i < distances_.size(); ++i) {
    std::uint16_t value = kGridBackground;
    if (distances_[i] != kInfinity) {
      const double share =
          range > 0 ? (static_cast<double>(distances_[i]) - grid.near_distance) / range : 0;
      value = static_cast<std::uint16_t>(std::lround(std::clamp(share, 0.0, 1.0) * kLevels));
    }
    base::StoreLittleEndian(value, grid.depths.data() + i * sizeof(value));
  }
  return grid;
}

DepthGrid MakeDepthGrid(const image::FrameImage& image, const view::View& view, int longer_side) {
  DepthGridBuilder builder({image.width, image.height}, longer_side);
  builder.Add({0, 0, image.width, image.height}, image, view, 0, 0);
  return builder.Make();
}

}  // namespace isoscope::server
