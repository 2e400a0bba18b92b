// The fragments of one block, in these steps:
//
// 1. The rectangle of the footprint is cut to the bounds of the open pixels. If it is empty, there
//    is nothing to do.
// 2. TransformVertices projects all vertices at once. If one of them lies in front of the near
//    plane or outside the guard band, the whole block takes the slow path (FillClipped). That path
//    projects vertex by vertex and clips only the triangles that need it.
// 3. A block of at most kMaxTinyExtentPx a side goes to FillTinyTriangles, which fills a triangle
//    in each lane and returns the triangles that are too large for it. Those, and all triangles of
//    a larger block, are filled one at a time (Fill).
// 4. A full buffer, and the last one, is flushed: fragments outside the open pixels are dropped,
//    then those outside the clip region, and the caller gets the rest.
//
// Both paths snap a vertex to the same position (screen_vertices.h), so neither can open a gap to
// the block next door.
//
// Clipping cuts a triangle by five planes: the near plane, then the four sides of the guard band.
// Each plane adds at most one corner, so a clipped triangle has at most 8.
//
// Sources: Olano, Greer 1997, "Triangle scan conversion using 2D homogeneous coordinates" (the
// weights); Sutherland, Hodgman 1974, "Reentrant polygon clipping".

#include "core/render/cpu_rasterizer.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>

#include "core/base/check.h"

namespace isoscope::render {
namespace {

view::PixelRect Intersection(const view::PixelRect& a, const view::PixelRect& b) {
  return {std::max(a.begin_x, b.begin_x), std::max(a.begin_y, b.begin_y),
          std::min(a.end_x, b.end_x), std::min(a.end_y, b.end_y)};
}

view::PixelRect BoundsOf(const image::PixelMask& mask) {
  return {mask.begin_column << mask.shift, mask.begin_row << mask.shift,
          (mask.begin_column + mask.columns) << mask.shift,
          (mask.begin_row + mask.rows) << mask.shift};
}

Projection ProjectionOf(const view::View& view) {
  return {.clip_from_index = view.clip_from_index().m,
          .width_px = static_cast<double>(view.viewport().width_px),
          .height_px = static_cast<double>(view.viewport().height_px),
          .origin_x = view.region().x,
          .origin_y = view.region().y,
          .guard_band_px =
              std::max(view.viewport().width_px, view.viewport().height_px) <= view::kMaxViewportPx
                  ? kGuardBandPx
                  : kWideGuardBandPx};
}

}  // namespace

std::optional<std::span<const view::HalfSpace>> CutsOf(const view::Clipper& clipper,
                                                       const volume::BlockLayout& layout,
                                                       volume::BlockId block_id) {
  using Side = view::Clipper::Side;
  const Side side = clipper.empty() ? Side::kInside : clipper.SideOf(layout, block_id);
  if (side == Side::kOutside) {
    return std::nullopt;
  }
  return side == Side::kCut ? clipper.half_spaces() : std::span<const view::HalfSpace>();
}

void CpuRasterizer::Fill(const ScreenVertex& a, const ScreenVertex& b, const ScreenVertex& c,
                         std::uint32_t triangle) {
  const view::PixelRect box{
      std::max(FirstPixelFrom(std::min({a.x, b.x, c.x})), rect_.begin_x),
      std::max(FirstPixelFrom(std::min({a.y, b.y, c.y})), rect_.begin_y),
      std::min(FirstPixelFrom(std::max({a.x, b.x, c.x}) + 1), rect_.end_x),
      std::min(FirstPixelFrom(std::max({a.y, b.y, c.y}) + 1), rect_.end_y),
  };
  if (box.empty()) {
    return;
  }
  const std::int64_t area =
      std::int64_t{b.x - a.x} * (c.y - a.y) - std::int64_t{c.x - a.x} * (b.y - a.y);
  if (area == 0) {
    return;
  }
  const ScreenTriangle screen{
      .v = area > 0 ? std::array{a, b, c} : std::array{a, c, b}, .index = triangle, .box = box};
  FillTriangle(screen, nearest_depth_, &fragments_, [this]() { Flush(); });
}

std::size_t CpuRasterizer::CutPolygon(const ClipVertex& plane, ClipPolygon* polygon,
                                      std::size_t count) {
  const auto distance = [&plane](const ClipVertex& v) {
    return plane.x * v.x + plane.y * v.y + plane.z * v.z + plane.w * v.w;
  };
  ClipPolygon cut;
  std::size_t cut_count = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const ClipVertex& a = (*polygon)[i];
    const ClipVertex& b = (*polygon)[(i + 1) % count];
    const double da = distance(a);
    const double db = distance(b);
    if (da >= 0) {
      cut[cut_count++] = a;
    }
    if ((da >= 0) != (db >= 0)) {
      // The new vertex is computed from the inner end to the outer one. So both triangles that
      // share the edge get the same point.
      const ClipVertex& inner = da >= 0 ? a : b;
      const ClipVertex& outer = da >= 0 ? b : a;
      const double inner_distance = da >= 0 ? da : db;
      const double outer_distance = da >= 0 ? db : da;
      const double t = inner_distance / (inner_distance - outer_distance);
      cut[cut_count++] = {inner.x + t * (outer.x - inner.x), inner.y + t * (outer.y - inner.y),
                          inner.z + t * (outer.z - inner.z), inner.w + t * (outer.w - inner.w)};
    }
  }
  *polygon = cut;
  return cut_count;
}

void CpuRasterizer::ClipAndFill(const mesh::CompactMesh& mesh, std::uint32_t triangle) {
  // A plane keeps the side of clip space where a.x x + a.y y + a.z z + a.w w >= 0. The guard band
  // is a little smaller than the one that ToScreen accepts, so that rounding can't push a clipped
  // vertex out again.
  const double band_px = projection_.guard_band_px - 1;
  const double gx_low = 1 + 2 * band_px / projection_.width_px;
  const double gx_high = 2 * band_px / projection_.width_px - 1;
  const double gy_low = 2 * band_px / projection_.height_px - 1;
  const double gy_high = 1 + 2 * band_px / projection_.height_px;
  const std::array<ClipVertex, 5> planes{ClipVertex{0, 0, 1, 1}, ClipVertex{1, 0, 0, gx_low},
                                         ClipVertex{-1, 0, 0, gx_high}, ClipVertex{0, 1, 0, gy_low},
                                         ClipVertex{0, -1, 0, gy_high}};
  ClipPolygon polygon;
  std::size_t count = 3;
  const std::array<std::uint32_t, 3> corners = mesh.triangles[triangle];
  for (std::size_t corner = 0; corner < 3; ++corner) {
    polygon[corner] = ToClip(projection_, mesh.positions[corners[corner]]);
  }
  for (const ClipVertex& plane : planes) {
    count = CutPolygon(plane, &polygon, count);
    if (count < 3) {
      return;
    }
  }
  std::array<ScreenVertex, 8> screen;
  for (std::size_t i = 0; i < count; ++i) {
    ClipVertex vertex = polygon[i];
    // The vertex may lie in front of the near plane by a rounding error.
    vertex.z = std::max(vertex.z, -vertex.w);
    const std::optional<ScreenVertex> projected = ToScreen(projection_, vertex);
    if (!projected) {
      return;  // the triangle degenerates into the eye
    }
    screen[i] = *projected;
  }
  for (std::size_t i = 2; i < count; ++i) {
    Fill(screen[0], screen[i - 1], screen[i], triangle);
  }
}

void CpuRasterizer::FillClipped(const mesh::CompactMesh& mesh) {
  clipped_vertices_.clear();
  for (const math::Vec3f& position : mesh.positions) {
    clipped_vertices_.push_back(ToScreen(projection_, ToClip(projection_, position)));
  }
  const auto triangle_count = static_cast<std::uint32_t>(mesh.triangle_count());
  for (std::uint32_t triangle = 0; triangle < triangle_count; ++triangle) {
    const auto [ia, ib, ic] = mesh.triangles[triangle];
    const std::optional<ScreenVertex>& a = clipped_vertices_[ia];
    const std::optional<ScreenVertex>& b = clipped_vertices_[ib];
    const std::optional<ScreenVertex>& c = clipped_vertices_[ic];
    if (a && b && c) {
      Fill(*a, *b, *c, triangle);
    } else {
      ClipAndFill(mesh, triangle);
    }
  }
}

void CpuRasterizer::FillFromVertices(const mesh::CompactMesh& mesh, std::uint32_t triangle) {
  const auto [a, b, c] = mesh.triangles[triangle];
  Fill(vertices_[a], vertices_[b], vertices_[c], triangle);
}

void CpuRasterizer::MeasureDistances() {
  distances_.clear();
  for (const view::HalfSpace& half_space : cut_by_) {
    for (const math::Vec3f& position : mesh_->positions) {
      distances_.push_back(view::Clipper::DistanceOf(half_space, position));
    }
  }
}

bool CpuRasterizer::IsClipped(std::uint32_t triangle, std::uint32_t pixel) const {
  const std::array<std::uint32_t, 3> corners = mesh_->triangles[triangle];
  std::optional<std::array<double, 3>> weights;  // computed only if a plane cuts the triangle
  for (std::size_t i = 0; i < cut_by_.size(); ++i) {
    const double* const plane_distances = distances_.data() + i * mesh_->positions.size();
    const std::array<double, 3> distances{plane_distances[corners[0]], plane_distances[corners[1]],
                                          plane_distances[corners[2]]};
    const int kept =
        (distances[0] >= 0 ? 1 : 0) + (distances[1] >= 0 ? 1 : 0) + (distances[2] >= 0 ? 1 : 0);
    if (kept == 3) {
      continue;
    }
    if (kept == 0) {
      return true;
    }
    if (!weights) {
      const auto weights_at =
          clip_weights_ == ClipWeights::kAtPixel ? BarycentricsAtPixel : BarycentricsNearPixel;
      weights = weights_at(*mesh_, triangle, *view_, static_cast<int>(pixel & 0xffff),
                           static_cast<int>(pixel >> 16));
    }
    if (!view::Clipper::IsKept(distances, *weights)) {
      return true;
    }
  }
  return false;
}

void CpuRasterizer::Flush() {
  if (open_ != nullptr) {
    fragments_.Retain([this](std::uint32_t pixel, std::uint32_t /*triangle*/) {
      return open_->Contains(static_cast<int>(pixel & 0xffff), static_cast<int>(pixel >> 16));
    });
  }
  if (!cut_by_.empty()) {
    fragments_.Retain([this](std::uint32_t pixel, std::uint32_t triangle) {
      return !IsClipped(triangle, pixel);
    });
  }
  if (fragments_.count > 0) {
    (*visit_)({.bounds = fragments_.bounds,
               .pixels = std::span(fragments_.pixels).first(fragments_.count),
               .depths = std::span(fragments_.depths).first(fragments_.count),
               .triangles = std::span(fragments_.triangles).first(fragments_.count)});
  }
  fragments_.Reset();
}

void CpuRasterizer::Rasterize(const mesh::CompactMesh& mesh, const view::View& view,
                              const view::Footprint& footprint, const image::PixelMask* open,
                              std::span<const view::HalfSpace> cut_by,
                              absl::FunctionRef<void(const FragmentBatch&)> visit,
                              ClipWeights clip_weights) {
  rect_ = footprint.rect;
  if (open != nullptr) {
    rect_ = Intersection(rect_, BoundsOf(*open));
  }
  if (rect_.empty() || mesh.triangles.empty()) {
    return;
  }
  projection_ = ProjectionOf(view);
  nearest_depth_ = footprint.nearest_depth;
  open_ = open;
  visit_ = &visit;
  mesh_ = &mesh;
  view_ = &view;
  cut_by_ = cut_by;
  clip_weights_ = clip_weights;
  if (!cut_by_.empty()) {
    MeasureDistances();
  }
  fragments_.Reset();
  const ScreenBounds bounds = TransformVertices(projection_, mesh.positions, &vertices_);
  if (!bounds.is_valid) {
    FillClipped(mesh);
    Flush();
    return;
  }
  const view::PixelRect mesh_rect =
      Intersection(rect_, {FirstPixelFrom(bounds.min_x), FirstPixelFrom(bounds.min_y),
                           FirstPixelFrom(bounds.max_x + 1), FirstPixelFrom(bounds.max_y + 1)});
  if (mesh_rect.empty()) {
    return;
  }
  if (std::max(bounds.max_x - bounds.min_x, bounds.max_y - bounds.min_y) <=
      kMaxTinyExtentPx * kSubpixels) {
    larger_.clear();
    FillTinyTriangles({.triangles = mesh.triangles,
                       .vertices = &vertices_,
                       .origin_x = bounds.min_x >> kSubpixelBits,
                       .origin_y = bounds.min_y >> kSubpixelBits,
                       .rect = mesh_rect,
                       .nearest_depth = nearest_depth_},
                      &fragments_, &larger_, [this]() { Flush(); });
    for (const std::uint32_t triangle : larger_) {
      FillFromVertices(mesh, triangle);
    }
  } else {
    const auto triangle_count = static_cast<std::uint32_t>(mesh.triangle_count());
    for (std::uint32_t triangle = 0; triangle < triangle_count; ++triangle) {
      FillFromVertices(mesh, triangle);
    }
  }
  Flush();
}

namespace {

// The corners of a triangle in clip space, x, y and w. Clip space is moved so that the pixel is the
// origin.
std::array<math::Vec3d, 3> CornersFromPixel(const mesh::CompactMesh& mesh, std::uint32_t triangle,
                                            const view::View& view, int x, int y) {
  const std::array<double, 16>& m = view.clip_from_index().m;
  const double ndc_x = 2 * (x + view.region().x + 0.5) / view.viewport().width_px - 1;
  const double ndc_y = 1 - 2 * (y + view.region().y + 0.5) / view.viewport().height_px;
  std::array<math::Vec3d, 3> corner;
  const std::array<std::uint32_t, 3> vertices = mesh.triangles[triangle];
  for (std::size_t i = 0; i < 3; ++i) {
    const math::Vec3f& p = mesh.positions[vertices[i]];
    const double px = static_cast<double>(p.x);
    const double py = static_cast<double>(p.y);
    const double pz = static_cast<double>(p.z);
    const double w = m[3] * px + m[7] * py + m[11] * pz + m[15];
    corner[i] = {m[0] * px + m[4] * py + m[8] * pz + m[12] - ndc_x * w,
                 m[1] * px + m[5] * py + m[9] * pz + m[13] - ndc_y * w, w};
  }
  return corner;
}

// The weight of a corner is the edge function of the two others.
std::array<double, 3> EdgeFunctions(const std::array<math::Vec3d, 3>& corner) {
  std::array<double, 3> weights;
  for (std::size_t i = 0; i < 3; ++i) {
    const math::Vec3d& p = corner[(i + 1) % 3];
    const math::Vec3d& q = corner[(i + 2) % 3];
    weights[i] = p.x * q.y - p.y * q.x;
  }
  return weights;
}

}  // namespace

std::array<double, 3> BarycentricsAtPixel(const mesh::CompactMesh& mesh, std::uint32_t triangle,
                                          const view::View& view, int x, int y) {
  std::array<double, 3> weights = EdgeFunctions(CornersFromPixel(mesh, triangle, view, x, y));
  const double sum = weights[0] + weights[1] + weights[2];
  double clamped_sum = 0;
  for (double& weight : weights) {
    weight = std::clamp(weight / sum, 0.0, 1.0);
    clamped_sum += weight;
  }
  // A triangle that is seen edge-on has no inside.
  if (!(clamped_sum > 0) || !std::isfinite(clamped_sum)) {
    return {1, 0, 0};
  }
  for (double& weight : weights) {
    weight /= clamped_sum;
  }
  return weights;
}

std::array<double, 3> BarycentricsNearPixel(const mesh::CompactMesh& mesh, std::uint32_t triangle,
                                            const view::View& view, int x, int y) {
  const std::array<math::Vec3d, 3> corner = CornersFromPixel(mesh, triangle, view, x, y);
  const std::array<double, 3> areas = EdgeFunctions(corner);
  const bool is_on_triangle = (areas[0] > 0 && areas[1] > 0 && areas[2] > 0) ||
                              (areas[0] < 0 && areas[1] < 0 && areas[2] < 0);
  const bool is_before_eye = corner[0].z > 0 && corner[1].z > 0 && corner[2].z > 0;
  if (is_on_triangle || !is_before_eye) {
    return BarycentricsAtPixel(mesh, triangle, view, x, y);
  }
  std::array<math::Vec3d, 3> screen;  // in pixels from the pixel, up to a factor
  for (std::size_t i = 0; i < 3; ++i) {
    screen[i] = {corner[i].x / corner[i].z * view.viewport().width_px,
                 corner[i].y / corner[i].z * view.viewport().height_px, 0};
  }
  std::array<double, 3> weights{1, 0, 0};
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t j = (i + 1) % 3;
    const math::Vec3d side = screen[j] - screen[i];
    const double squared = math::Dot(side, side);
    const double along =
        squared > 0 ? std::clamp(-math::Dot(screen[i], side) / squared, 0.0, 1.0) : 0;
    const math::Vec3d nearest = screen[i] + side * along;
    if (const double distance = math::Dot(nearest, nearest); distance < least) {
      least = distance;
      // Weights that are linear on the screen are divided by w to get those in space.
      const double share_i = (1 - along) / corner[i].z;
      const double share_j = along / corner[j].z;
      weights = {};
      weights[i] = share_i / (share_i + share_j);
      weights[j] = share_j / (share_i + share_j);
    }
  }
  return weights;
}

}  // namespace isoscope::render
