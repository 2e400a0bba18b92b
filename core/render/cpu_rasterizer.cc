// Based on:
// Pineda 1988, "A parallel algorithm for polygon rasterization" (edge functions);
// Olano, Greer 1997, "Triangle scan conversion using 2D homogeneous coordinates" (weights);
// Sutherland, Hodgman 1974, "Reentrant polygon clipping".

#include "core/render/cpu_rasterizer.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>

#include "core/base/check.h"

namespace isoscope::render {
namespace {

constexpr int kSubpixelBits = 8;
constexpr std::int32_t kSubpixels = 1 << kSubpixelBits;
constexpr std::int32_t kHalfPixel = kSubpixels / 2;
// Vertices further out than this are clipped first, so that products of coordinate differences fit
// 64 bits with room: (2 * 2^15 px * 2^8)^2 = 2^48.
constexpr double kGuardBandPx = 32768;
// Triangles no larger than this are filled with 32-bit edge functions: (2^6 px * 2^8)^2 * 2 < 2^31.
constexpr std::int32_t kSmallTrianglePx = 60;

// The first pixel whose centre is at or right of `x` (1/256 pixels).
constexpr std::int32_t FirstPixelFrom(std::int32_t x) {
  return (x + kHalfPixel - 1) >> kSubpixelBits;
}

}  // namespace

void CpuRasterizer::TransformVertices(const mesh::BlockMesh& mesh, const view::View& view) {
  width_ = view.viewport().width_px;
  height_ = view.viewport().height_px;
  clip_from_index_ = view.clip_from_index().m;
  vertices_.resize(mesh.positions.size());
  needs_clipping_.assign(mesh.positions.size(), 0);
  const std::array<double, 16>& m = clip_from_index_;
  for (std::size_t i = 0; i < mesh.positions.size(); ++i) {
    const double x = static_cast<double>(mesh.positions[i].x);
    const double y = static_cast<double>(mesh.positions[i].y);
    const double z = static_cast<double>(mesh.positions[i].z);
    const ClipVertex clip{
        m[0] * x + m[4] * y + m[8] * z + m[12], m[1] * x + m[5] * y + m[9] * z + m[13],
        m[2] * x + m[6] * y + m[10] * z + m[14], m[3] * x + m[7] * y + m[11] * z + m[15]};
    needs_clipping_[i] = Project(clip, &vertices_[i]) ? 0 : 1;
  }
}

bool CpuRasterizer::Project(const ClipVertex& clip, ScreenVertex* screen) const {
  if (!(clip.w > 0) || !(clip.z >= -clip.w)) {
    return false;
  }
  const double inverse_w = 1.0 / clip.w;
  const double x = (clip.x * inverse_w * 0.5 + 0.5) * width_;
  const double y = (0.5 - clip.y * inverse_w * 0.5) * height_;
  if (!(std::abs(x) <= kGuardBandPx && std::abs(y) <= kGuardBandPx)) {
    return false;
  }
  screen->x = static_cast<std::int32_t>(std::lrint(x * kSubpixels));
  screen->y = static_cast<std::int32_t>(std::lrint(y * kSubpixels));
  screen->z = static_cast<float>(clip.z * inverse_w * 0.5 + 0.5);
  return true;
}

void CpuRasterizer::Emit(const ScreenVertex& a, const ScreenVertex& b, const ScreenVertex& c,
                         std::uint32_t triangle) {
  const view::PixelRect& rect = footprint_.rect;
  const std::int32_t begin_x = std::max(FirstPixelFrom(std::min({a.x, b.x, c.x})), rect.begin_x);
  const std::int32_t end_x = std::min(FirstPixelFrom(std::max({a.x, b.x, c.x}) + 1), rect.end_x);
  if (begin_x >= end_x) {
    return;
  }
  const std::int32_t begin_y = std::max(FirstPixelFrom(std::min({a.y, b.y, c.y})), rect.begin_y);
  const std::int32_t end_y = std::min(FirstPixelFrom(std::max({a.y, b.y, c.y}) + 1), rect.end_y);
  if (begin_y >= end_y) {
    return;
  }
  const std::int64_t area =
      std::int64_t{b.x - a.x} * (c.y - a.y) - std::int64_t{c.x - a.x} * (b.y - a.y);
  if (area == 0) {
    return;
  }
  ScreenTriangle& out = triangles_.emplace_back();
  out.v = area > 0 ? std::array{a, b, c} : std::array{a, c, b};
  out.index = triangle;
  out.begin_x = begin_x;
  out.begin_y = begin_y;
  out.end_x = end_x;
  out.end_y = end_y;
  bounds_.begin_x = std::min(bounds_.begin_x, begin_x);
  bounds_.begin_y = std::min(bounds_.begin_y, begin_y);
  bounds_.end_x = std::max(bounds_.end_x, end_x);
  bounds_.end_y = std::max(bounds_.end_y, end_y);
}

void CpuRasterizer::ClipAndEmit(const mesh::BlockMesh& mesh, std::uint32_t triangle) {
  // A plane is the side of clip space where a.x x + a.y y + a.z z + a.w w >= 0. The guard band is a
  // little inside what Project takes, so that rounding can't push a clipped vertex out again.
  constexpr double kBandPx = kGuardBandPx - 1;
  const double gx_low = 1 + 2 * kBandPx / width_;
  const double gx_high = 2 * kBandPx / width_ - 1;
  const double gy_low = 2 * kBandPx / height_ - 1;
  const double gy_high = 1 + 2 * kBandPx / height_;
  const std::array<ClipVertex, 5> planes{ClipVertex{0, 0, 1, 1}, ClipVertex{1, 0, 0, gx_low},
                                         ClipVertex{-1, 0, 0, gx_high}, ClipVertex{0, 1, 0, gy_low},
                                         ClipVertex{0, -1, 0, gy_high}};
  const std::array<double, 16>& m = clip_from_index_;
  std::array<ClipVertex, 8> polygon;
  std::size_t count = 3;
  for (std::size_t corner = 0; corner < 3; ++corner) {
    const math::Vec3f& p = mesh.positions[mesh.indices[3 * std::size_t{triangle} + corner]];
    const double x = static_cast<double>(p.x);
    const double y = static_cast<double>(p.y);
    const double z = static_cast<double>(p.z);
    polygon[corner] = {
        m[0] * x + m[4] * y + m[8] * z + m[12], m[1] * x + m[5] * y + m[9] * z + m[13],
        m[2] * x + m[6] * y + m[10] * z + m[14], m[3] * x + m[7] * y + m[11] * z + m[15]};
  }
  for (const ClipVertex& plane : planes) {
    const auto distance = [&plane](const ClipVertex& v) {
      return plane.x * v.x + plane.y * v.y + plane.z * v.z + plane.w * v.w;
    };
    std::array<ClipVertex, 8> clipped;
    std::size_t clipped_count = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const ClipVertex& a = polygon[i];
      const ClipVertex& b = polygon[(i + 1) % count];
      const double da = distance(a);
      const double db = distance(b);
      if (da >= 0) {
        clipped[clipped_count++] = a;
      }
      if ((da >= 0) != (db >= 0)) {
        // From the inner to the outer end, whichever triangle asks: both get the same point.
        const ClipVertex& inner = da >= 0 ? a : b;
        const ClipVertex& outer = da >= 0 ? b : a;
        const double inner_distance = da >= 0 ? da : db;
        const double outer_distance = da >= 0 ? db : da;
        const double t = inner_distance / (inner_distance - outer_distance);
        clipped[clipped_count++] = {
            inner.x + t * (outer.x - inner.x), inner.y + t * (outer.y - inner.y),
            inner.z + t * (outer.z - inner.z), inner.w + t * (outer.w - inner.w)};
      }
    }
    polygon = clipped;
    count = clipped_count;
    if (count < 3) {
      return;
    }
  }
  std::array<ScreenVertex, 8> screen;
  for (std::size_t i = 0; i < count; ++i) {
    ClipVertex vertex = polygon[i];
    // On the near plane up to rounding.
    vertex.z = std::max(vertex.z, -vertex.w);
    if (!Project(vertex, &screen[i])) {
      return;  // the triangle degenerates into the eye
    }
  }
  for (std::size_t i = 2; i < count; ++i) {
    Emit(screen[0], screen[i - 1], screen[i], triangle);
  }
}

template <typename Int>
void CpuRasterizer::FillTriangle(const ScreenTriangle& triangle, const view::PixelRect& rect) {
  const auto& [a, b, c] = triangle.v;
  const std::int32_t begin_x = std::max(triangle.begin_x, std::int32_t{rect.begin_x});
  const std::int32_t end_x = std::min(triangle.end_x, std::int32_t{rect.end_x});
  const std::int32_t begin_y = std::max(triangle.begin_y, std::int32_t{rect.begin_y});
  const std::int32_t end_y = std::min(triangle.end_y, std::int32_t{rect.end_y});

  // Edge functions at the first pixel centre; >= 0 inside. A pixel centre on an edge belongs to the
  // triangle only if the edge is a top or a left one.
  const Int x = Int{begin_x * kSubpixels + kHalfPixel};
  const Int y = Int{begin_y * kSubpixels + kHalfPixel};
  const auto edge = [x, y](const ScreenVertex& from, const ScreenVertex& to) {
    const Int dx = Int{to.x - from.x};
    const Int dy = Int{to.y - from.y};
    const bool is_top_left = dy < 0 || (dy == 0 && dx > 0);
    return dx * (y - from.y) - dy * (x - from.x) - (is_top_left ? 0 : 1);
  };
  Int row_ab = edge(a, b);
  Int row_bc = edge(b, c);
  Int row_ca = edge(c, a);
  const Int step_x_ab = Int{a.y - b.y} * kSubpixels;
  const Int step_x_bc = Int{b.y - c.y} * kSubpixels;
  const Int step_x_ca = Int{c.y - a.y} * kSubpixels;
  const Int step_y_ab = Int{b.x - a.x} * kSubpixels;
  const Int step_y_bc = Int{c.x - b.x} * kSubpixels;
  const Int step_y_ca = Int{a.x - c.x} * kSubpixels;

  // The depth plane through the three vertices, from a. The arithmetic is the same whichever tile
  // asks: it starts at the vertex, not at the tile.
  const auto ux = static_cast<double>(b.x - a.x);
  const auto uy = static_cast<double>(b.y - a.y);
  const auto vx = static_cast<double>(c.x - a.x);
  const auto vy = static_cast<double>(c.y - a.y);
  const auto uz = static_cast<double>(b.z) - static_cast<double>(a.z);
  const auto vz = static_cast<double>(c.z) - static_cast<double>(a.z);
  const double inverse_area = 1.0 / (ux * vy - vx * uy);
  const double depth_per_x = (uz * vy - vz * uy) * inverse_area;
  const double depth_per_y = (vz * ux - uz * vx) * inverse_area;
  // Slivers have steep planes: a fragment is never outside its own triangle's depths.
  const float nearest = footprint_.nearest_depth;
  const float depth_low = std::min(std::max(std::min({a.z, b.z, c.z}), nearest), 1.0F);
  const float depth_high = std::min(std::max(std::max({a.z, b.z, c.z}), nearest), 1.0F);

  const int stride = rect.end_x - rect.begin_x;
  for (std::int32_t py = begin_y; py < end_y; ++py) {
    Int ab = row_ab;
    Int bc = row_bc;
    Int ca = row_ca;
    std::uint64_t* row =
        keys_.data() + static_cast<std::ptrdiff_t>(py - rect.begin_y) * stride - rect.begin_x;
    const double depth_of_row =
        static_cast<double>(a.z) + depth_per_y * (py * kSubpixels + kHalfPixel - a.y);
    for (std::int32_t px = begin_x; px < end_x; ++px) {
      if ((ab | bc | ca) >= 0) {
        const double plane = depth_of_row + depth_per_x * (px * kSubpixels + kHalfPixel - a.x);
        // + 0 turns -0 into +0, whose bits are the smallest.
        const float depth =
            std::min(std::max(static_cast<float>(plane), depth_low), depth_high) + 0.0F;
        const std::uint64_t key =
            std::uint64_t{std::bit_cast<std::uint32_t>(depth)} << 32 | triangle.index;
        row[px] = std::min(row[px], key);
      }
      ab += step_x_ab;
      bc += step_x_bc;
      ca += step_x_ca;
    }
    row_ab += step_y_ab;
    row_bc += step_y_bc;
    row_ca += step_y_ca;
  }
}

void CpuRasterizer::FillTile(const view::PixelRect& rect) {
  const auto pixel_count = static_cast<std::size_t>(rect.end_x - rect.begin_x) *
                           static_cast<std::size_t>(rect.end_y - rect.begin_y);
  keys_.assign(pixel_count, KeyTile::kNoKey);
  for (const ScreenTriangle& triangle : triangles_) {
    if (triangle.begin_x >= rect.end_x || triangle.end_x <= rect.begin_x ||
        triangle.begin_y >= rect.end_y || triangle.end_y <= rect.begin_y) {
      continue;
    }
    const auto& v = triangle.v;
    const auto [low_x, high_x] = std::minmax({v[0].x, v[1].x, v[2].x});
    const auto [low_y, high_y] = std::minmax({v[0].y, v[1].y, v[2].y});
    if (high_x - low_x <= kSmallTrianglePx * kSubpixels &&
        high_y - low_y <= kSmallTrianglePx * kSubpixels) {
      FillTriangle<std::int32_t>(triangle, rect);
    } else {
      FillTriangle<std::int64_t>(triangle, rect);
    }
  }
}

void CpuRasterizer::Rasterize(const mesh::BlockMesh& mesh, const view::View& view,
                              const view::Footprint& footprint,
                              absl::FunctionRef<void(const KeyTile&)> visit) {
  footprint_ = footprint;
  TransformVertices(mesh, view);
  triangles_.clear();
  bounds_ = {width_, height_, 0, 0};
  const auto triangle_count = static_cast<std::uint32_t>(mesh.triangle_count());
  for (std::uint32_t triangle = 0; triangle < triangle_count; ++triangle) {
    const std::uint32_t* corners = &mesh.indices[3 * std::size_t{triangle}];
    if ((needs_clipping_[corners[0]] | needs_clipping_[corners[1]] | needs_clipping_[corners[2]]) ==
        0) [[likely]] {
      Emit(vertices_[corners[0]], vertices_[corners[1]], vertices_[corners[2]], triangle);
    } else {
      ClipAndEmit(mesh, triangle);
    }
  }
  if (triangles_.empty()) {
    return;
  }
  for (int y = bounds_.begin_y; y < bounds_.end_y; y += kTilePx) {
    for (int x = bounds_.begin_x; x < bounds_.end_x; x += kTilePx) {
      const view::PixelRect rect{x, y, std::min(x + kTilePx, bounds_.end_x),
                                 std::min(y + kTilePx, bounds_.end_y)};
      FillTile(rect);
      visit({rect, keys_.data()});
    }
  }
}

std::array<double, 3> BarycentricsAtPixel(const mesh::BlockMesh& mesh, std::uint32_t triangle,
                                          const view::View& view, int x, int y) {
  const std::array<double, 16>& m = view.clip_from_index().m;
  const double ndc_x = 2 * (x + 0.5) / view.viewport().width_px - 1;
  const double ndc_y = 1 - 2 * (y + 0.5) / view.viewport().height_px;
  // Moved so that the pixel is the origin: a weight is the edge function of the two other corners.
  std::array<math::Vec3d, 3> corner;
  for (std::size_t i = 0; i < 3; ++i) {
    const math::Vec3f& p = mesh.positions[mesh.indices[3 * std::size_t{triangle} + i]];
    const double px = static_cast<double>(p.x);
    const double py = static_cast<double>(p.y);
    const double pz = static_cast<double>(p.z);
    const double w = m[3] * px + m[7] * py + m[11] * pz + m[15];
    corner[i] = {m[0] * px + m[4] * py + m[8] * pz + m[12] - ndc_x * w,
                 m[1] * px + m[5] * py + m[9] * pz + m[13] - ndc_y * w, w};
  }
  std::array<double, 3> weights;
  double sum = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    const math::Vec3d& p = corner[(i + 1) % 3];
    const math::Vec3d& q = corner[(i + 2) % 3];
    weights[i] = p.x * q.y - p.y * q.x;
    sum += weights[i];
  }
  double clamped_sum = 0;
  for (double& weight : weights) {
    weight = std::clamp(weight / sum, 0.0, 1.0);
    clamped_sum += weight;
  }
  // Edge-on triangles have no inside to speak of.
  if (!(clamped_sum > 0) || !std::isfinite(clamped_sum)) {
    return {1, 0, 0};
  }
  for (double& weight : weights) {
    weight /= clamped_sum;
  }
  return weights;
}

}  // namespace isoscope::render
