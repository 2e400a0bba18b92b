// The arithmetic of occluder_selection.h: makes rays and walks them from block to block, one ray to
// a vector lane. Internal to core/visibility. All instruction sets give the same bits.

#ifndef ISOSCOPE_CORE_VISIBILITY_RAY_KERNEL_H_
#define ISOSCOPE_CORE_VISIBILITY_RAY_KERNEL_H_

#include <cstdint>

#include "core/math/matrix.h"
#include "core/math/vec.h"

namespace isoscope::visibility {

// The data that all rays of a frame share.
struct RayScene {
  math::Index3 block_dims;  // blocks on each axis
  math::Vec3d block_size;   // of a whole block, cells
  math::Vec3d size;         // of the volume, cells

  // The camera in index space: the eye; the vectors of one unit of depth, of half an image to the
  // right and of half an image up (perspective: at distance 1).
  bool is_perspective = true;
  math::Vec3d eye;
  math::Vec3d forward;
  math::Vec3d half_right;
  math::Vec3d half_up;
  double near_distance = 0;
  // The view's matrices, for rays through face centres.
  math::Mat4d clip_from_index;
  math::Mat4d world_from_index;
  math::Vec3d world_eye;
  math::Vec3d world_forward;

  // Of the rows and columns of boundary faces, every face_stride-th has rays, from about the middle
  // of the first face_stride on.
  std::int64_t face_stride = 1;

  // The grid over the viewport, with one random ray in each cell.
  std::uint64_t seed = 0;
  std::int64_t grid_columns = 0;
  std::int64_t grid_rows = 0;
};

// The rays of one row of boundary faces, or of one row of cells of the image plane.
struct RayRow {
  int axis = -1;          // normal to the faces; -1: a row of the image plane
  bool is_upper = false;  // faces at the axis' upper end
  std::int64_t row = 0;   // of those that have rays
};

// Casts the rays [begin_column, end_column) of a row, and inserts the first active block of each
// into `hits`.
//
// active, hits: one bit a block, 64 to a word, as in volume::BlockSet
//
// REQUIRES: the columns exist. O(blocks on an axis) for each ray. Thread-safe for different `hits`.
void CastRow(const RayScene& scene, const RayRow& row, std::int64_t begin_column,
             std::int64_t end_column, const std::uint64_t* active, std::uint64_t* hits);

// The data of a volume::BlockTree of active blocks.
struct ActiveTree {
  math::Index3 brick_dims;
  const std::uint32_t* cells = nullptr;
  const std::uint64_t* words = nullptr;
};

// Does the same with a tree, whose empty cubes a ray crosses at once (tree_walk_kernel.cc). Several
// times as fast where most of a large volume is empty.
//
// hits: one bit a block, as active.words
void CastRow(const RayScene& scene, const RayRow& row, std::int64_t begin_column,
             std::int64_t end_column, const ActiveTree& active, std::uint64_t* hits);

// Makes one ray of a row. False if it goes through a face centre that the viewport does not show.
bool MakeRay(const RayScene& scene, const RayRow& row, std::int64_t column, math::Vec3d* origin,
             math::Vec3d* direction);

}  // namespace isoscope::visibility

#endif  // ISOSCOPE_CORE_VISIBILITY_RAY_KERNEL_H_
