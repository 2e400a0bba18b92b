#include "core/visibility/occluder_selection.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <limits>

#include "core/base/check.h"
#include "core/base/random.h"
#include "core/math/matrix.h"

namespace isoscope::visibility {
namespace {

// How dense the random rays are. They find what the face centres miss: blocks inside the volume
// that show between others. To be tuned by measurement (tests/benchmarks/visibility_benchmark.cc):
// more rays cost time in step 1 and save blocks in step 3.
constexpr double kPixelsPerRay = 8.0 * 8.0;
constexpr double kMinImageRays = 1024;
constexpr double kMaxImageRays = 65536;
// Face centres this far outside the image are still cast: a part of their block may show.
constexpr double kViewportSlack = 1.02;

// A position on a grid that is walked row by row, to and fro: neighbours in number are neighbours
// on the grid.
struct GridCell {
  std::int64_t column;
  std::int64_t row;
};
GridCell SnakeCell(std::int64_t number, std::int64_t columns) {
  const std::int64_t row = number / columns;
  const std::int64_t column = number % columns;
  return {row % 2 == 0 ? column : columns - 1 - column, row};
}

// The number of blocks on each face that is normal to `axis`.
std::int64_t FaceBlocks(const math::Index3& block_dims, int axis) {
  return block_dims[(axis + 1) % 3] * block_dims[(axis + 2) % 3];
}

// What a walk needs to know of the block grid.
struct BlockGrid {
  explicit BlockGrid(const volume::BlockLayout& layout)
      : dims(layout.block_dims()), strides{1, dims.x, dims.x * dims.y} {
    for (int axis = 0; axis < 3; ++axis) {
      block_size[axis] = static_cast<double>(layout.block_cells()[axis]);
      size[axis] = static_cast<double>(layout.sample_dims()[axis] - 1);
    }
  }

  math::Index3 dims;
  math::Index3 strides;
  math::Vec3d block_size;  // cells
  math::Vec3d size;        // cells
};

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// The first active block along the ray, or none.
std::optional<volume::BlockId> FirstActiveBlock(const Ray& ray, const BlockGrid& grid,
                                                const volume::BlockSet& active) {
  // The part [t_enter, t_exit] of the ray that is inside the volume, by slabs.
  double t_enter = 0;
  double t_exit = kInfinity;
  int enter_axis = -1;
  for (int axis = 0; axis < 3; ++axis) {
    const double origin = ray.origin[axis];
    const double direction = ray.direction[axis];
    if (direction == 0) {
      if (!(origin >= 0 && origin <= grid.size[axis])) {
        return std::nullopt;
      }
      continue;
    }
    const double t_low = (0 - origin) / direction;
    const double t_high = (grid.size[axis] - origin) / direction;
    const double t_first = std::min(t_low, t_high);
    if (t_first > t_enter) {
      t_enter = t_first;
      enter_axis = axis;
    }
    t_exit = std::min(t_exit, std::max(t_low, t_high));
  }
  if (!(t_enter <= t_exit)) {
    return std::nullopt;
  }

  std::array<std::int64_t, 3> steps_left{};
  std::array<std::int64_t, 3> id_step{};
  std::array<double, 3> t_next{};
  std::array<double, 3> t_step{};
  std::int64_t id = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<std::size_t>(axis);
    const double direction = ray.direction[axis];
    const std::int64_t last = grid.dims[axis] - 1;
    std::int64_t index = 0;
    if (axis == enter_axis) {
      index = direction > 0 ? 0 : last;  // exact, where the division might round across the face
    } else {
      const double position = ray.origin[axis] + direction * t_enter;
      index = static_cast<std::int64_t>(
          std::clamp(std::floor(position / grid.block_size[axis]), 0.0, static_cast<double>(last)));
    }
    id += index * grid.strides[axis];
    if (direction == 0) {
      t_next[a] = kInfinity;
      continue;
    }
    const bool forward = direction > 0;
    const double boundary =
        static_cast<double>(forward ? index + 1 : index) * grid.block_size[axis];
    t_next[a] = (boundary - ray.origin[axis]) / direction;
    t_step[a] = grid.block_size[axis] / std::abs(direction);
    steps_left[a] = forward ? last - index : index;
    id_step[a] = forward ? grid.strides[axis] : -grid.strides[axis];
  }

  // Every step uses up one of steps_left, so the walk ends whatever the rounding.
  while (true) {
    if (active.Contains(static_cast<volume::BlockId>(id))) {
      return static_cast<volume::BlockId>(id);
    }
    const std::size_t a = t_next[0] <= t_next[1] ? (t_next[0] <= t_next[2] ? 0 : 2)
                                                 : (t_next[1] <= t_next[2] ? 1 : 2);
    // The last block of an axis may be smaller than the step: there t_exit ends the walk.
    if (steps_left[a] == 0 || t_next[a] > t_exit) {
      return std::nullopt;
    }
    --steps_left[a];
    id += id_step[a];
    t_next[a] += t_step[a];
  }
}

}  // namespace

RaySet::RaySet(const view::View& view, const volume::BlockLayout& layout, std::uint64_t seed)
    : view_(view), layout_(layout), seed_(seed) {
  for (int axis = 0; axis < 3; ++axis) {
    face_ray_count_ += 2 * FaceBlocks(layout.block_dims(), axis);
  }

  const double width = view.viewport().width_px;
  const double height = view.viewport().height_px;
  const double wanted = std::clamp(width * height / kPixelsPerRay, kMinImageRays, kMaxImageRays);
  const double cell_px = std::sqrt(width * height / wanted);
  grid_columns_ = std::max<std::int64_t>(1, std::llround(width / cell_px));
  grid_rows_ = std::max<std::int64_t>(1, std::llround(height / cell_px));
  image_ray_count_ = grid_columns_ * grid_rows_;

  const view::Camera& camera = view.camera();
  const double half_height = camera.projection == view::Projection::kPerspective
                                 ? std::tan(camera.fov_y_radians / 2)
                                 : camera.view_height / 2;
  const math::Mat4d& index_from_world = view.index_from_world();
  eye_ = math::TransformPoint(index_from_world, camera.eye);
  forward_ = math::TransformVector(index_from_world, view.forward());
  half_right_ =
      math::TransformVector(index_from_world, view.right() * (half_height * width / height));
  half_up_ = math::TransformVector(index_from_world, view.up() * half_height);
}

std::optional<Ray> RaySet::RayOf(std::int64_t number) const {
  if (number < face_ray_count_) {
    return FaceRay(number);
  }
  return ImageRay(number - face_ray_count_);
}

std::optional<Ray> RaySet::FaceRay(std::int64_t number) const {
  int axis = 0;
  while (number >= 2 * FaceBlocks(layout_.block_dims(), axis)) {
    number -= 2 * FaceBlocks(layout_.block_dims(), axis);
    ++axis;
  }
  const std::int64_t face_blocks = FaceBlocks(layout_.block_dims(), axis);
  const bool is_upper = number >= face_blocks;
  const int u = (axis + 1) % 3;
  const int v = (axis + 2) % 3;
  const GridCell cell =
      SnakeCell(is_upper ? number - face_blocks : number, layout_.block_dims()[u]);

  math::Index3 block;
  block[axis] = is_upper ? layout_.block_dims()[axis] - 1 : 0;
  block[u] = cell.column;
  block[v] = cell.row;
  const math::IndexBox cells = layout_.CellsOf(layout_.IdOf(block));
  math::Vec3d center;
  for (const int side : {u, v}) {
    center[side] = 0.5 * static_cast<double>(cells.begin[side] + cells.end[side]);
  }
  center[axis] = static_cast<double>(is_upper ? cells.end[axis] : cells.begin[axis]);

  const math::Vec4d clip = view_.clip_from_index() * math::Vec4d{center.x, center.y, center.z, 1};
  if (!(clip.w > 0) || std::abs(clip.x) > kViewportSlack * clip.w ||
      std::abs(clip.y) > kViewportSlack * clip.w) {
    return std::nullopt;
  }
  if (view_.camera().projection == view::Projection::kPerspective) {
    return Ray{eye_, center - eye_};
  }
  const math::Vec3d offset =
      math::TransformPoint(view_.world_from_index(), center) - view_.camera().eye;
  const double distance = math::Dot(view_.forward(), offset);
  return Ray{center + forward_ * (view_.near_distance() - distance), forward_};
}

Ray RaySet::ImageRay(std::int64_t number) const {
  const GridCell cell = SnakeCell(number, grid_columns_);
  const auto counter = static_cast<std::uint64_t>(number) * 2;
  const double x = (static_cast<double>(cell.column) + base::RandomUnit(seed_, counter)) /
                   static_cast<double>(grid_columns_);
  const double y = (static_cast<double>(cell.row) + base::RandomUnit(seed_, counter + 1)) /
                   static_cast<double>(grid_rows_);
  const math::Vec3d offset = half_right_ * (2 * x - 1) + half_up_ * (1 - 2 * y);
  if (view_.camera().projection == view::Projection::kPerspective) {
    return {eye_, forward_ + offset};
  }
  return {eye_ + offset + forward_ * view_.near_distance(), forward_};
}

std::vector<volume::BlockId> RaySet::Cast(std::int64_t begin, std::int64_t end,
                                          const volume::BlockSet& active) const {
  ISOSCOPE_CHECK_LE(0, begin);
  ISOSCOPE_CHECK_LE(begin, end);
  ISOSCOPE_CHECK_LE(end, count());
  const BlockGrid grid(layout_);
  volume::BlockSet seen(layout_.block_count());
  std::vector<volume::BlockId> hits;
  for (std::int64_t number = begin; number < end; ++number) {
    const std::optional<Ray> ray = RayOf(number);
    if (!ray.has_value()) {
      continue;
    }
    const std::optional<volume::BlockId> hit = FirstActiveBlock(*ray, grid, active);
    if (hit.has_value() && !seen.Contains(*hit)) {
      seen.Insert(*hit);
      hits.push_back(*hit);
    }
  }
  std::sort(hits.begin(), hits.end());
  return hits;
}

RayShare ShareOfRays(std::int64_t ray_count, int agent_index, int agent_count) {
  ISOSCOPE_CHECK_LE(0, agent_index);
  ISOSCOPE_CHECK_LT(agent_index, agent_count);
  // The first `rest` agents cast one ray more.
  const std::int64_t share = ray_count / agent_count;
  const std::int64_t rest = ray_count % agent_count;
  const auto begin_of = [&](std::int64_t agent) { return agent * share + std::min(agent, rest); };
  return {begin_of(agent_index), begin_of(std::int64_t{agent_index} + 1)};
}

std::vector<volume::BlockId> UnionOfHits(const std::vector<volume::BlockId>& a,
                                         const std::vector<volume::BlockId>& b) {
  std::vector<volume::BlockId> both;
  both.reserve(a.size() + b.size());
  std::set_union(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(both));
  return both;
}

volume::BlockSet OccludingBlocks(const std::vector<volume::BlockId>& hits,
                                 const volume::BlockLayout& layout,
                                 const volume::BlockSet& active) {
  volume::BlockSet occluding(layout.block_count());
  const math::Index3& dims = layout.block_dims();
  for (const volume::BlockId hit : hits) {
    const math::Index3 center = layout.IndexOf(hit);
    math::IndexBox around;
    for (int axis = 0; axis < 3; ++axis) {
      around.begin[axis] = std::max<std::int64_t>(center[axis] - 1, 0);
      around.end[axis] = std::min(center[axis] + 2, dims[axis]);
    }
    for (std::int64_t z = around.begin.z; z < around.end.z; ++z) {
      for (std::int64_t y = around.begin.y; y < around.end.y; ++y) {
        for (std::int64_t x = around.begin.x; x < around.end.x; ++x) {
          const volume::BlockId id = layout.IdOf({x, y, z});
          if (active.Contains(id)) {
            occluding.Insert(id);
          }
        }
      }
    }
    occluding.Insert(hit);
  }
  return occluding;
}

}  // namespace isoscope::visibility
