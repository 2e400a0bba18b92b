// Two steps for a band of rows:
//
//   1. Edges. A pixel is an edge if one of its four neighbours is background, or shows another
//      surface that is not nearer, or lies behind a jump. A jump is a growth in distance beyond the
//      slopes beside the two, by kJumpShare of the height that the viewport shows there. So a jump
//      does not depend on the number of pixels, on zoom, or on the units of the volume.
//   2. Lines. A pixel belongs to a line if an edge of its surface lies within the width, and does
//      not lie in front of it by a jump. That is a maximum over a disc: each edge raises the pixels
//      around it, row by row of its disc, to the farthest distance that it paints.
//
// Example, width 2, one row of distances with a jump of 3: 10 10 10 10 | 20 20 20 20. The fourth
// pixel is an edge. It paints itself and the third one, not the fifth, which lies behind it.

#include "core/picture/silhouette.h"

#include <algorithm>
#include <bitset>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/frame/frame_spec.h"
#include "core/view/unprojection.h"

namespace isoscope::picture {
namespace {

constexpr double kJumpShare = 0.015;
constexpr int kBandRows = 64;
constexpr std::uint8_t kNoSurface = 255;
constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr float kNothing = -1;  // nearer than all distances
static_assert(frame::kMaxSurfaces < kNoSurface);

// The growth of a distance that counts as a jump.
struct JumpRule {
  float base = 0;
  float per_distance = 0;

  [[nodiscard]] float At(float distance) const { return base + per_distance * distance; }
};

JumpRule MakeJumpRule(const view::View& view) {
  const auto height = static_cast<float>(kJumpShare * 2 * view.image_plane().half_height);
  return view.image_plane().is_perspective ? JumpRule{.per_distance = height}
                                           : JumpRule{.base = height};
}

// Distances and surfaces of some rows of the image. A row outside the image is none.
class Rows {
 public:
  Rows(const image::FrameImage& image, const view::Unprojection& unprojection,
       const image::FragmentOrder& order, int begin_y, int end_y)
      : width_(image.width),
        begin_y_(std::max(begin_y, 0)),
        end_y_(std::min(end_y, image.height)),
        distances_(static_cast<std::size_t>(width_) * static_cast<std::size_t>(end_y_ - begin_y_)),
        surfaces_(distances_.size(), kNoSurface) {
    const std::uint64_t* const keys = image.keys.data() + image.IndexOf(0, begin_y_);
    for (std::size_t i = 0; i < distances_.size(); ++i) {
      // Without branches, so that compilers turn it into SIMD.
      const float distance = unprojection.DistanceOf(image::DepthOf(keys[i]));
      distances_[i] = image::OwnerOf(keys[i]) == image::kNoOwner ? kInfinity : distance;
    }
    for (std::size_t i = 0; i < distances_.size(); ++i) {
      if (image::OwnerOf(keys[i]) != image::kNoOwner) {
        surfaces_[i] = static_cast<std::uint8_t>(order.SurfaceOf(image::OwnerOf(keys[i])));
        seen_.set(surfaces_[i]);
      }
    }
  }

  // Sets may_be[x] to 1 if pixel (x, y) can be an edge: a neighbour is much farther, or there are
  // several surfaces.
  void FindCandidates(const JumpRule& jumps, int y, std::vector<std::uint8_t>* may_be) const {
    may_be->assign(static_cast<std::size_t>(width_), seen_.count() > 1 ? 1 : 0);
    if (seen_.count() > 1) {
      return;
    }
    const float* const here = distances_.data() + IndexOf(0, y);
    const float* const above = distances_.data() + IndexOf(0, std::max(y - 1, begin_y_));
    const float* const below = distances_.data() + IndexOf(0, std::min(y + 1, end_y_ - 1));
    const auto is_near = [&](int x, int left, int right) {
      const float farthest =
          std::max(std::max(above[x], below[x]), std::max(here[left], here[right]));
      return static_cast<std::uint8_t>(farthest - here[x] > jumps.At(here[x]));
    };
    std::uint8_t* const to = may_be->data();
    to[0] = is_near(0, 0, std::min(1, width_ - 1));
    for (int x = 1; x < width_ - 1; ++x) {
      to[x] = is_near(x, x - 1, x + 1);
    }
    to[width_ - 1] = is_near(width_ - 1, std::max(width_ - 2, 0), width_ - 1);
  }

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] std::size_t size() const { return surfaces_.size(); }
  [[nodiscard]] int begin_y() const { return begin_y_; }
  [[nodiscard]] int end_y() const { return end_y_; }
  [[nodiscard]] bool has_surface(std::uint8_t surface) const { return seen_[surface]; }
  [[nodiscard]] bool is_empty() const { return seen_.none(); }
  [[nodiscard]] std::uint8_t SurfaceAt(int x, int y) const { return surfaces_[IndexOf(x, y)]; }
  [[nodiscard]] float DistanceAt(int x, int y) const { return distances_[IndexOf(x, y)]; }
  [[nodiscard]] bool Contains(int x, int y) const {
    return x >= 0 && x < width_ && y >= begin_y_ && y < end_y_;
  }

 private:
  [[nodiscard]] std::size_t IndexOf(int x, int y) const {
    return static_cast<std::size_t>(y - begin_y_) * static_cast<std::size_t>(width_) +
           static_cast<std::size_t>(x);
  }

  const int width_;
  const int begin_y_;
  const int end_y_;
  std::vector<float> distances_;
  std::vector<std::uint8_t> surfaces_;
  std::bitset<256> seen_;
};

// Returns the growth of the distance from (x, y) to (x + dx, y + dy): 0 if it does not grow, or if
// the two are not of one surface.
float GrowthAt(const Rows& rows, int x, int y, int dx, int dy) {
  if (!rows.Contains(x, y) || !rows.Contains(x + dx, y + dy) ||
      rows.SurfaceAt(x, y) != rows.SurfaceAt(x + dx, y + dy)) {
    return 0;
  }
  return std::max(rows.DistanceAt(x + dx, y + dy) - rows.DistanceAt(x, y), 0.0F);
}

// Whether the surface at (x, y) ends towards (x + dx, y + dy).
bool EndsTowards(const Rows& rows, const JumpRule& jumps, int x, int y, int dx, int dy) {
  const int to_x = x + dx;
  const int to_y = y + dy;
  if (!rows.Contains(to_x, to_y)) {
    return false;
  }
  const std::uint8_t surface = rows.SurfaceAt(x, y);
  const std::uint8_t other = rows.SurfaceAt(to_x, to_y);
  if (other == kNoSurface) {
    return true;
  }
  const float distance = rows.DistanceAt(x, y);
  const float farther = rows.DistanceAt(to_x, to_y) - distance;
  if (other != surface) {
    return farther > 0 || (farther == 0 && surface < other);
  }
  const float jump = jumps.At(distance);
  if (farther <= jump) {
    return false;
  }
  const float slope =
      std::max(GrowthAt(rows, x - dx, y - dy, dx, dy), GrowthAt(rows, to_x, to_y, dx, dy));
  return farther - slope > jump;
}

bool IsEdge(const Rows& rows, const JumpRule& jumps, int x, int y) {
  return rows.SurfaceAt(x, y) != kNoSurface &&
         (EndsTowards(rows, jumps, x, y, 1, 0) || EndsTowards(rows, jumps, x, y, -1, 0) ||
          EndsTowards(rows, jumps, x, y, 0, 1) || EndsTowards(rows, jumps, x, y, 0, -1));
}

// The pixels of a disc around its centre, row by row: half its width, from the row radius - 1
// above.
std::vector<int> DiscOf(int radius) {
  std::vector<int> half_widths;
  for (int dy = 1 - radius; dy < radius; ++dy) {
    int half = 0;
    while ((half + 1) * (half + 1) + dy * dy < radius * radius) {
      ++half;
    }
    half_widths.push_back(half);
  }
  return half_widths;
}

// Paints the rows [begin_y, end_y) of the image.
class Band {
 public:
  Band(const Rows& rows, const JumpRule& jumps, int radius, int begin_y, int end_y)
      : rows_(rows),
        jumps_(jumps),
        disc_(DiscOf(radius)),
        radius_(radius),
        begin_y_(begin_y),
        end_y_(end_y),
        first_edge_y_(std::max(begin_y - radius + 1, rows.begin_y())),
        last_edge_y_(std::min(end_y + radius - 1, rows.end_y())) {
    std::vector<std::uint8_t> is_edge;
    for (int y = first_edge_y_; y < last_edge_y_; ++y) {
      rows.FindCandidates(jumps, y, &is_edge);
      for (int x = 0; x < rows.width(); ++x) {
        if (is_edge[static_cast<std::size_t>(x)] != 0) {
          is_edge[static_cast<std::size_t>(x)] = IsEdge(rows, jumps, x, y) ? 1 : 0;
        }
      }
      is_edge_.insert(is_edge_.end(), is_edge.begin(), is_edge.end());
    }
  }

  void Paint(image::Rgba8 color, image::FrameImage* image) {
    for (std::uint8_t surface = 0; surface < frame::kMaxSurfaces; ++surface) {
      if (rows_.has_surface(surface)) {
        PaintSurface(surface, color, image);
      }
    }
  }

 private:
  void PaintSurface(std::uint8_t surface, image::Rgba8 color, image::FrameImage* image) {
    const auto width = static_cast<std::size_t>(rows_.width());
    farthest_.assign(width * static_cast<std::size_t>(end_y_ - begin_y_), kNothing);
    std::size_t edge = 0;
    for (int y = first_edge_y_; y < last_edge_y_; ++y) {
      for (int x = 0; x < rows_.width(); ++x, ++edge) {
        if (is_edge_[edge] != 0 && rows_.SurfaceAt(x, y) == surface) {
          const float distance = rows_.DistanceAt(x, y);
          Raise(x, y, distance + jumps_.At(distance));
        }
      }
    }
    std::size_t i = 0;
    for (int y = begin_y_; y < end_y_; ++y) {
      for (int x = 0; x < rows_.width(); ++x, ++i) {
        if (farthest_[i] >= 0 && rows_.SurfaceAt(x, y) == surface &&
            rows_.DistanceAt(x, y) <= farthest_[i]) {
          image->colors[image->IndexOf(x, y)] = color;
        }
      }
    }
  }

  // Lets the edge at (x, y) paint the pixels that are not behind `farthest`.
  void Raise(int edge_x, int edge_y, float farthest) {
    const int begin = std::max(edge_y - radius_ + 1, begin_y_);
    const int end = std::min(edge_y + radius_, end_y_);
    for (int y = begin; y < end; ++y) {
      const int half = disc_[static_cast<std::size_t>(y - edge_y + radius_ - 1)];
      float* const row = farthest_.data() + static_cast<std::size_t>(y - begin_y_) *
                                                static_cast<std::size_t>(rows_.width());
      const int last = std::min(edge_x + half, rows_.width() - 1);
      for (int x = std::max(edge_x - half, 0); x <= last; ++x) {
        row[x] = row[x] < farthest ? farthest : row[x];
      }
    }
  }

  const Rows& rows_;
  const JumpRule& jumps_;
  const std::vector<int> disc_;
  const int radius_;
  const int begin_y_;
  const int end_y_;
  // The rows whose edges paint the band.
  const int first_edge_y_;
  const int last_edge_y_;
  std::vector<std::uint8_t> is_edge_;  // of these rows
  std::vector<float> farthest_;        // of the band, for one surface
};

}  // namespace

void DrawSilhouettes(const frame::Silhouette& silhouette, const view::View& view,
                     const image::FragmentOrder& order, int samples_per_side,
                     image::FrameImage* image) {
  const view::Unprojection unprojection(view);
  const JumpRule jumps = MakeJumpRule(view);
  const int radius = silhouette.width_px * samples_per_side;
  const int bands = (image->height + kBandRows - 1) / kBandRows;
  // Bands read keys and write colours, so they do not meet.
  tbb::parallel_for(0, bands, [&](int band) {
    const int begin_y = band * kBandRows;
    const int end_y = std::min(begin_y + kBandRows, image->height);
    const int reach = radius + frame::Silhouette::kBorderPx;
    const Rows rows(*image, unprojection, order, begin_y - reach, end_y + reach);
    if (!rows.is_empty()) {
      Band(rows, jumps, radius, begin_y, end_y).Paint(silhouette.color, image);
    }
  });
}

}  // namespace isoscope::picture
