// The rays of a frame, their division among agents, and the step from hits to occluding blocks. The
// walk of a ray is in ray_kernel.cc.
//
// Ray indices count the faces of the volume's sides first, axis by axis, the lower side before the
// upper, then the cells of a grid over the image. Rows alternate in direction, so that successive
// rays are neighbours:
//
//        row 0    0 -> 1 -> 2
//                           |
//        row 1    5 <- 4 <- 3
//
// Example: 4 x 3 x 2 blocks have 2 * (3 * 2 + 2 * 4 + 4 * 3) = 52 face rays: 0 to 11 normal to x,
// 12 to 27 to y, 28 to 51 to z. Ray 3 goes through row 1, column 2 of the lower x side, whose
// columns count along y and rows along z. A viewport of 1024 x 1024 pixels has 128 x 128 = 16384
// rays more, from 52 on.
//
// A volume with more than RaySet::kMaxFaceRays boundary faces has rays through every second, third,
// ... row and column of them: any set of occluders gives the same picture.
//
// An agent casts a contiguous share. The union of all hits does not depend on the shares, because a
// ray is a function of its index. Hits and their active 26-neighbours occlude: a surface that a ray
// meets continues in the neighbouring blocks.
//
// Source: Zhang, Bajaj and Ramachandran 2002, section 3.1 (references.bib:
// zhang-random-distribution).

#include "core/visibility/occluder_selection.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "absl/types/span.h"

#include "core/base/check.h"
#include "core/math/matrix.h"

namespace isoscope::visibility {
namespace {

// The density of random rays. They find blocks that rays through face centres miss: blocks inside
// the volume that are visible between others. Four times as many rays save less than 2 % of the
// triangles (docs/lab/experiments.md).
constexpr double kPixelsPerRay = 8.0 * 8.0;
constexpr double kMinImageRays = 1024;
constexpr double kMaxImageRays = 65536;

// Returns the number of faces that have a ray, on an axis of `block_count` blocks.
std::int64_t FacesOn(std::int64_t block_count, std::int64_t stride) {
  return (block_count + stride - 1) / stride;
}

// Returns the number of rays through a side of the volume that is normal to `axis`.
std::int64_t SideRays(const math::Index3& block_dims, std::int64_t stride, int axis) {
  return FacesOn(block_dims[(axis + 1) % 3], stride) * FacesOn(block_dims[(axis + 2) % 3], stride);
}

// Returns the number of rays through all sides.
std::int64_t FaceRays(const math::Index3& block_dims, std::int64_t stride) {
  return 2 * (SideRays(block_dims, stride, 0) + SideRays(block_dims, stride, 1) +
              SideRays(block_dims, stride, 2));
}

// Sets to[to_begin + i] where from[from_begin + i] is set, for 0 <= i < count: bits, 64 to a word.
// REQUIRES: both ranges exist; from and to do not overlap.
void OrBits(absl::Span<const std::uint64_t> from, std::int64_t from_begin, std::int64_t count,
            std::int64_t to_begin, absl::Span<std::uint64_t> to) {
  if (count <= 0) {
    return;
  }
  const std::int64_t offset = from_begin - to_begin;
  const std::int64_t word_offset = offset >> 6;
  const auto shift = static_cast<int>(offset & 63);
  const auto from_size = static_cast<std::int64_t>(from.size());
  const auto word_of = [&](std::int64_t index) {
    return index >= 0 && index < from_size ? from[static_cast<std::size_t>(index)] : 0;
  };
  // Returns the 64 bits of `from` that fall on a word of `to`.
  const auto incoming = [&](std::int64_t word) {
    const std::uint64_t low = word_of(word + word_offset) >> shift;
    return shift == 0 ? low : low | word_of(word + word_offset + 1) << (64 - shift);
  };
  const std::int64_t to_end = to_begin + count;
  const std::int64_t first = to_begin / 64;
  const std::int64_t last = (to_end - 1) / 64;
  const std::uint64_t first_mask = ~std::uint64_t{0} << (to_begin % 64);
  const std::uint64_t last_mask = ~std::uint64_t{0} >> (63 - (to_end - 1) % 64);
  if (first == last) {
    to[static_cast<std::size_t>(first)] |= incoming(first) & first_mask & last_mask;
    return;
  }
  to[static_cast<std::size_t>(first)] |= incoming(first) & first_mask;
  to[static_cast<std::size_t>(last)] |= incoming(last) & last_mask;
  // Between the first and the last word, both source words exist.
  std::uint64_t* const out = to.data();
  if (shift == 0) {
    const std::uint64_t* const in = from.data() + word_offset;
    for (std::int64_t word = first + 1; word < last; ++word) {
      out[word] |= in[word];
    }
    return;
  }
  for (std::int64_t word = first + 1; word < last; ++word) {
    const std::uint64_t* const in = from.data() + (word + word_offset);
    out[word] |= in[0] >> shift | in[1] << (64 - shift);
  }
}

// Removes the block at `column` from every row of blocks.
void EraseColumn(const math::Index3& dims, std::int64_t column, absl::Span<std::uint64_t> words) {
  for (std::int64_t id = column; id < math::Volume(dims); id += dims.x) {
    words[static_cast<std::size_t>(id / 64)] &= ~(std::uint64_t{1} << (id % 64));
  }
}

}  // namespace

// The neighbours along x, then those of all these along y, then along z. Each is a shift of the
// whole set, by 1, dims.x or a slab of ids.
void AddNeighbours(const math::Index3& dims, volume::BlockSet* blocks) {
  const std::int64_t count = math::Volume(dims);
  const std::int64_t slab = dims.x * dims.y;
  const absl::Span<std::uint64_t> grown = blocks->words();
  // Along x, the next id after the end of a row belongs to another row.
  volume::BlockSet not_first = *blocks;
  EraseColumn(dims, 0, not_first.words());
  volume::BlockSet not_last = *blocks;
  EraseColumn(dims, dims.x - 1, not_last.words());
  OrBits(not_first.words(), 1, count - 1, 0, grown);
  OrBits(not_last.words(), 0, count - 1, 1, grown);

  volume::BlockSet before = *blocks;
  for (std::int64_t begin = 0; begin < count; begin += slab) {
    OrBits(before.words(), begin + dims.x, slab - dims.x, begin, grown);
    OrBits(before.words(), begin, slab - dims.x, begin + dims.x, grown);
  }
  before = *blocks;
  OrBits(before.words(), slab, count - slab, 0, grown);
  OrBits(before.words(), 0, count - slab, slab, grown);
}

namespace {

// Aims the rays at a region: its centre becomes the middle of the image plane, its half sides the
// plane's half sides, and everything outside the region is outside the frustum.
void AimAtRegion(const view::View& view, RayScene* scene) {
  const view::Region& region = view.region();
  const double width = view.viewport().width_px;
  const double height = view.viewport().height_px;
  // In half sides of the whole, right and up from its centre.
  const double center_x = (2.0 * region.x + region.width_px) / width - 1;
  const double center_y = 1 - (2.0 * region.y + region.height_px) / height;
  const double share_x = region.width_px / width;
  const double share_y = region.height_px / height;
  math::Vec3d& center = scene->is_perspective ? scene->forward : scene->eye;
  center = center + scene->half_right * center_x + scene->half_up * center_y;
  scene->half_right = scene->half_right * share_x;
  scene->half_up = scene->half_up * share_y;
  math::Mat4d region_from_clip;
  region_from_clip.At(0, 0) = 1 / share_x;
  region_from_clip.At(0, 3) = -center_x / share_x;
  region_from_clip.At(1, 1) = 1 / share_y;
  region_from_clip.At(1, 3) = -center_y / share_y;
  scene->clip_from_index = region_from_clip * scene->clip_from_index;
}

}  // namespace

RaySet::RaySet(const view::View& view, const volume::BlockLayout& layout, std::uint64_t seed,
               std::int64_t max_face_rays) {
  ISOSCOPE_CHECK_GE(max_face_rays, 6);
  scene_.block_dims = layout.block_dims();
  while (FaceRays(scene_.block_dims, scene_.face_stride) > max_face_rays) {
    ++scene_.face_stride;
  }
  face_ray_count_ = FaceRays(scene_.block_dims, scene_.face_stride);
  for (int axis = 0; axis < 3; ++axis) {
    scene_.block_size[axis] = static_cast<double>(layout.block_cells()[axis]);
    scene_.size[axis] = static_cast<double>(layout.sample_dims()[axis] - 1);
  }

  const double width = view.image_size().width_px;
  const double height = view.image_size().height_px;
  const double least = view.is_whole() ? kMinImageRays : std::min(kMinImageRays, width * height);
  const double wanted = std::clamp(width * height / kPixelsPerRay, least, kMaxImageRays);
  const double cell_px = std::sqrt(width * height / wanted);
  scene_.seed = seed;
  scene_.grid_columns = std::max<std::int64_t>(1, std::llround(width / cell_px));
  scene_.grid_rows = std::max<std::int64_t>(1, std::llround(height / cell_px));
  image_ray_count_ = scene_.grid_columns * scene_.grid_rows;

  const view::ImagePlane& plane = view.image_plane();
  scene_.is_perspective = plane.is_perspective;
  const math::Mat4d& index_from_world = view.index_from_world();
  scene_.eye = math::TransformPoint(index_from_world, view.camera().eye);
  scene_.forward = math::TransformVector(index_from_world, view.forward());
  scene_.half_right = math::TransformVector(index_from_world, view.right() * plane.half_width);
  scene_.half_up = math::TransformVector(index_from_world, view.up() * plane.half_height);
  scene_.near_distance = view.near_distance();
  scene_.clip_from_index = view.clip_from_index();
  scene_.world_from_index = view.world_from_index();
  scene_.world_eye = view.camera().eye;
  scene_.world_forward = view.forward();
  if (!view.is_whole()) {
    AimAtRegion(view, &scene_);
  }
}

RaySet::RowPart RaySet::RowPartAt(std::int64_t begin, std::int64_t end) const {
  RowPart part;
  std::int64_t columns = scene_.grid_columns;
  std::int64_t offset = begin - face_ray_count_;  // in the image plane, or in one side's faces
  if (begin < face_ray_count_) {
    offset = begin;
    part.row.axis = 0;
    std::int64_t side_rays = SideRays(scene_.block_dims, scene_.face_stride, 0);
    while (offset >= 2 * side_rays) {
      offset -= 2 * side_rays;
      side_rays = SideRays(scene_.block_dims, scene_.face_stride, ++part.row.axis);
    }
    part.row.is_upper = offset >= side_rays;
    offset -= part.row.is_upper ? side_rays : 0;
    columns = FacesOn(scene_.block_dims[(part.row.axis + 1) % 3], scene_.face_stride);
  }
  part.row.row = offset / columns;
  const std::int64_t step = offset % columns;
  part.count = std::min(columns - step, end - begin);
  part.begin_column = part.row.row % 2 == 0 ? step : columns - step - part.count;
  return part;
}

std::optional<Ray> RaySet::RayOf(std::int64_t ray_index) const {
  ISOSCOPE_CHECK_LE(0, ray_index);
  ISOSCOPE_CHECK_LT(ray_index, count());
  const RowPart part = RowPartAt(ray_index, ray_index + 1);
  Ray ray;
  if (!MakeRay(scene_, part.row, part.begin_column, &ray.origin, &ray.direction)) {
    return std::nullopt;
  }
  return ray;
}

void RaySet::Cast(std::int64_t begin, std::int64_t end, const volume::BlockSet& active,
                  volume::BlockSet* hits) const {
  ISOSCOPE_CHECK_LE(0, begin);
  ISOSCOPE_CHECK_LE(begin, end);
  ISOSCOPE_CHECK_LE(end, count());
  const auto word_count = static_cast<std::size_t>((math::Volume(scene_.block_dims) + 63) / 64);
  ISOSCOPE_CHECK_EQ(active.words().size(), word_count);
  ISOSCOPE_CHECK_EQ(hits->words().size(), word_count);
  while (begin < end) {
    const RowPart part = RowPartAt(begin, end);
    CastRow(scene_, part.row, part.begin_column, part.begin_column + part.count,
            active.words().data(), hits->words().data());
    begin += part.count;
  }
}

void RaySet::Cast(std::int64_t begin, std::int64_t end, const volume::BlockTree& active,
                  absl::Span<std::uint64_t> hits) const {
  ISOSCOPE_CHECK_LE(0, begin);
  ISOSCOPE_CHECK_LE(begin, end);
  ISOSCOPE_CHECK_LE(end, count());
  ISOSCOPE_CHECK(active.block_dims() == scene_.block_dims);
  ISOSCOPE_CHECK_EQ(hits.size(), active.words().size());
  const ActiveTree tree{active.brick_dims(), active.cells().data(), active.words().data()};
  while (begin < end) {
    const RowPart part = RowPartAt(begin, end);
    CastRow(scene_, part.row, part.begin_column, part.begin_column + part.count, tree, hits.data());
    begin += part.count;
  }
}

RayShare ShareOfRays(std::int64_t ray_count, int agent_index, int agent_count) {
  ISOSCOPE_CHECK_LE(0, agent_index);
  ISOSCOPE_CHECK_LT(agent_index, agent_count);
  // Each of the first `rest` agents casts one ray more.
  const std::int64_t share = ray_count / agent_count;
  const std::int64_t rest = ray_count % agent_count;
  const auto begin_of = [&](std::int64_t agent) { return agent * share + std::min(agent, rest); };
  return {begin_of(agent_index), begin_of(std::int64_t{agent_index} + 1)};
}

volume::BlockSet OccludingBlocks(const volume::BlockSet& hits, const volume::BlockLayout& layout,
                                 const volume::BlockSet& active) {
  volume::BlockSet occluding = hits;
  AddNeighbours(layout.block_dims(), &occluding);
  occluding.IntersectWith(active);
  occluding.UnionWith(hits);
  return occluding;
}

}  // namespace isoscope::visibility
