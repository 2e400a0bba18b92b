// The arithmetic of occluder_selection.h: makes rays and walks them through the blocks, one ray to
// a vector lane. Internal to core/visibility. The same bits whatever the processor's vectors are.

#ifndef ISOSCOPE_CORE_VISIBILITY_RAY_KERNEL_H_
#define ISOSCOPE_CORE_VISIBILITY_RAY_KERNEL_H_

#include <cstdint>

#include "core/math/matrix.h"
#include "core/math/vec.h"

namespace isoscope::visibility {

// What all rays of a frame share. Plain data.
struct RayScene {
  // The blocks: how many on each axis, their size, and that of all of them (cells).
  math::Index3 block_dims;
  math::Vec3d block_size;
  math::Vec3d size;

  // The camera in index space: the eye, and what one unit of depth, half an image to the right and
  // half an image up are (perspective: at distance 1).
  bool is_perspective = true;
  math::Vec3d eye;
  math::Vec3d forward;
  math::Vec3d half_right;
  math::Vec3d half_up;
  double near_distance = 0;
  // Of the view, for the face centres.
  math::Mat4d clip_from_index;
  math::Mat4d world_from_index;
  math::Vec3d world_eye;
  math::Vec3d world_forward;

  // The cells of random rays.
  std::uint64_t seed = 0;
  std::int64_t grid_columns = 0;
  std::int64_t grid_rows = 0;
};

// The rays of one row of boundary faces, or of one row of cells of the image plane.
struct RayRow {
  int axis = -1;          // the normal of the faces; -1: the image plane
  bool is_upper = false;  // the faces at the axis' upper end
  std::int64_t row = 0;
};

// Inserts into `hits` the first active block of each of the rays [begin_column, end_column) of a
// row. `active` and `hits`: one bit a block, 64 to a word, as volume::BlockSet has them.
// REQUIRES: the columns exist.
void CastRow(const RayScene& scene, const RayRow& row, std::int64_t begin_column,
             std::int64_t end_column, const std::uint64_t* active, std::uint64_t* hits);

// One ray of a row; false if it goes through a face centre that the viewport does not show.
bool MakeRay(const RayScene& scene, const RayRow& row, std::int64_t column, math::Vec3d* origin,
             math::Vec3d* direction);

}  // namespace isoscope::visibility

#endif  // ISOSCOPE_CORE_VISIBILITY_RAY_KERNEL_H_
