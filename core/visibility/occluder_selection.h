// Step 1 of a frame: rays through the blocks find a first guess of what can be seen. No sample is
// read, only spans. Source: the paper, section 3.1 (references.bib: zhang-random-distribution).

#ifndef ISOSCOPE_CORE_VISIBILITY_OCCLUDER_SELECTION_H_
#define ISOSCOPE_CORE_VISIBILITY_OCCLUDER_SELECTION_H_

#include <cstdint>
#include <optional>
#include <vector>

#include "core/math/vec.h"
#include "core/view/view.h"
#include "core/visibility/ray_kernel.h"
#include "core/volume/block_layout.h"
#include "core/volume/range_table.h"

namespace isoscope::visibility {

// The half-line origin + t * direction, t >= 0, in index space (samples).
struct Ray {
  math::Vec3d origin;
  math::Vec3d direction;
};

// The rays of a frame, numbered 0 .. count() - 1 in spatially coherent order: first the centres of
// all boundary faces of all boundary blocks, then random points of the image plane. A ray is a pure
// function of (view, layout, seed, number): it does not depend on who casts it.
// Immutable; thread-safe. O(1) to make.
class RaySet {
 public:
  // REQUIRES: the layout is that of the view's volume. There is about one random ray for every
  // 8 x 8 pixels, at least 1024 and at most 65536 or so, one in each cell of a grid over the
  // viewport.
  RaySet(const view::View& view, const volume::BlockLayout& layout, std::uint64_t seed);

  [[nodiscard]] std::int64_t count() const { return face_ray_count_ + image_ray_count_; }

  // Ray `number`; none if it goes through a face centre that the viewport does not show. It starts
  // at the eye (perspective) or on the near plane (orthographic).
  // REQUIRES: 0 <= number < count().
  [[nodiscard]] std::optional<Ray> RayOf(std::int64_t number) const;

  // Casts rays [begin, end). Each stops at the first active block it meets at or behind the eye
  // and inside the frustum's side planes; inserts the blocks hit into `hits`, so that a thread
  // gathers all it casts in one set. Rays of one row of faces or cells go side by side through the
  // processor's vector lanes; the hits depend neither on that nor on how the rays are divided.
  // REQUIRES: 0 <= begin <= end <= count(); both sets are of the layout's blocks. O(blocks on an
  // axis) for each ray. Source of the walk: Amanatides, Woo 1987, "A fast voxel traversal algorithm
  // for ray tracing".
  void Cast(std::int64_t begin, std::int64_t end, const volume::BlockSet& active,
            volume::BlockSet* hits) const;

 private:
  // Rays that lie in one row, numbered to and fro: neighbours in number are neighbours in space.
  struct Run {
    RayRow row;
    std::int64_t begin_column = 0;
    std::int64_t count = 0;
  };
  // The longest run from ray `begin` on that ends by `end`.
  [[nodiscard]] Run RunAt(std::int64_t begin, std::int64_t end) const;

  RayScene scene_;
  std::int64_t face_ray_count_ = 0;
  std::int64_t image_ray_count_ = 0;
};

// The share of an agent: rays [Begin, End) of `ray_count` for agent `agent_index` of `agent_count`.
struct RayShare {
  std::int64_t begin = 0;
  std::int64_t end = 0;
};
RayShare ShareOfRays(std::int64_t ray_count, int agent_index, int agent_count);

// The reduce of step 1: the union of sorted hit lists, sorted, each block once. Associative,
// commutative, idempotent.
std::vector<volume::BlockId> UnionOfHits(const std::vector<volume::BlockId>& a,
                                         const std::vector<volume::BlockId>& b);

// The occluding blocks: the hits and those of their 26 neighbours that are active.
// REQUIRES: the hits are blocks of the layout. O(hits + blocks / 64).
volume::BlockSet OccludingBlocks(const std::vector<volume::BlockId>& hits,
                                 const volume::BlockLayout& layout, const volume::BlockSet& active);

}  // namespace isoscope::visibility

#endif  // ISOSCOPE_CORE_VISIBILITY_OCCLUDER_SELECTION_H_
