// Step 1 of a frame: rays through the grid of blocks give a first estimate of the visible blocks.
// Only spans are read, no samples. Source: Zhang, Bajaj and Ramachandran 2002, section 3.1
// (references.bib: zhang-random-distribution).

#ifndef ISOSCOPE_CORE_VISIBILITY_OCCLUDER_SELECTION_H_
#define ISOSCOPE_CORE_VISIBILITY_OCCLUDER_SELECTION_H_

#include <cstdint>
#include <optional>
#include <vector>

#include "absl/types/span.h"

#include "core/math/vec.h"
#include "core/view/view.h"
#include "core/visibility/ray_kernel.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_set.h"
#include "core/volume/block_tree.h"

namespace isoscope::visibility {

// The half-line origin + t * direction, t >= 0, in index space (samples).
struct Ray {
  math::Vec3d origin;
  math::Vec3d direction;
};

// The rays of a frame, with ray indices 0 .. count() - 1 in spatially coherent order: first those
// through the centres of the boundary faces of boundary blocks, then those through random points of
// the image plane. A ray is a pure function of (view, layout, seed, ray index): it does
// not depend on the agent that casts it. Immutable; thread-safe. O(1) to make.
class RaySet {
 public:
  // More rays through faces would cost more than the picture has pixels to show.
  static constexpr std::int64_t kMaxFaceRays = std::int64_t{1} << 18;

  // All boundary faces have a ray if that makes at most max_face_rays, by default of up to 209^3
  // blocks. Otherwise every n-th row and column of each side has, with the least n that is enough.
  //
  // Random rays go through the cells of a grid over the picture, one through each: about one for
  // every 8 x 8 pixels, at least about 1024 and at most about 65536. A region of a viewport has at
  // most about one for every pixel, and only rays that meet it: they choose the blocks that may
  // hide others there.
  // REQUIRES: the layout is that of the view's volume; max_face_rays >= 6.
  RaySet(const view::View& view, const volume::BlockLayout& layout, std::uint64_t seed,
         std::int64_t max_face_rays = kMaxFaceRays);

  [[nodiscard]] std::int64_t count() const { return face_ray_count_ + image_ray_count_; }

  // Returns a ray; none if it goes through a face centre that the viewport does not show. A ray
  // starts at the eye (perspective) or on the near plane (orthographic).
  // REQUIRES: 0 <= ray_index < count().
  [[nodiscard]] std::optional<Ray> RayOf(std::int64_t ray_index) const;

  // Casts the rays [begin, end) and inserts the first active block of each into `hits`. The hits do
  // not depend on how the rays are divided. O(blocks on an axis) for each ray.
  // REQUIRES: 0 <= begin <= end <= count(); both sets are of the layout's blocks.
  // Source: Amanatides and Woo 1987 (references.bib: amanatides-woo).
  void Cast(std::int64_t begin, std::int64_t end, const volume::BlockSet& active,
            volume::BlockSet* hits) const;
  // Finds the same hits, and marks them in `hits`, which has the shape of active.words(). Rays cross
  // empty cubes at once.
  void Cast(std::int64_t begin, std::int64_t end, const volume::BlockTree& active,
            absl::Span<std::uint64_t> hits) const;

 private:
  // Rays of successive indices in one row, as columns from left to right.
  struct RowPart {
    RayRow row;
    std::int64_t begin_column = 0;
    std::int64_t count = 0;
  };
  // Returns the most rays of one row that begin with ray `begin` and end by `end`.
  [[nodiscard]] RowPart RowPartAt(std::int64_t begin, std::int64_t end) const;

  RayScene scene_;
  std::int64_t face_ray_count_ = 0;
  std::int64_t image_ray_count_ = 0;
};

// The rays [begin, end) that an agent casts.
struct RayShare {
  std::int64_t begin = 0;
  std::int64_t end = 0;
};
// Divides the rays evenly. REQUIRES: 0 <= agent_index < agent_count.
RayShare ShareOfRays(std::int64_t ray_count, int agent_index, int agent_count);

// Returns the occluding blocks: the hits, and those of their 26 neighbours that are active. `hits`:
// of all agents. It is a set, so the result depends neither on the order of the agents nor on their
// number. O(blocks / 64).
volume::BlockSet OccludingBlocks(const volume::BlockSet& hits, const volume::BlockLayout& layout,
                                 const volume::BlockSet& active);

// Adds to a set of blocks all 26 neighbours of each. O(blocks / 64).
//
// dims: blocks on each axis
void AddNeighbours(const math::Index3& dims, volume::BlockSet* blocks);

}  // namespace isoscope::visibility

#endif  // ISOSCOPE_CORE_VISIBILITY_OCCLUDER_SELECTION_H_
