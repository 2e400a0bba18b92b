// The part of a volume that a frame shows. Fragments outside are dropped, one by one; whole blocks
// outside are never read.
//
// Clipped pictures are exact for two reasons. IsKept decides about a fragment from its triangle and
// pixel alone. SideOf only skips work whose result is certain: a fragment's weights are not
// negative, so its distance to a plane lies between those of its triangle's vertices. These lie
// between those of the corners of its block (docs/numerics.md).

#ifndef ISOSCOPE_CORE_VIEW_CLIP_REGION_H_
#define ISOSCOPE_CORE_VIEW_CLIP_REGION_H_

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "core/math/box.h"
#include "core/math/vec.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_set.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::view {

// The points p with Dot(normal, p) >= offset.
struct HalfSpace {
  math::Vec3d normal;
  double offset = 0;

  friend bool operator==(const HalfSpace&, const HalfSpace&) = default;
};

inline constexpr std::size_t kMaxHalfSpaces = 6;  // of a request; a box adds as many

// The intersection of its members, in world space. Without members: the whole space.
struct ClipRegion {
  std::vector<HalfSpace> half_spaces;
  std::optional<math::Box3d> box;

  friend bool operator==(const ClipRegion&, const ClipRegion&) = default;
};

// A clip region in the index space of one grid. Immutable; thread-safe.
class Clipper {
 public:
  Clipper() = default;  // clips nothing
  Clipper(const ClipRegion& region, const volume::GridGeometry& geometry);

  // Returns true if nothing is clipped.
  [[nodiscard]] bool empty() const { return half_spaces_.empty(); }
  // In index space, those of the region first, then those of the box; at most 12.
  [[nodiscard]] std::span<const HalfSpace> half_spaces() const { return half_spaces_; }

  // kCut: there may be points inside and outside.
  enum class Side { kInside, kOutside, kCut };
  // Returns the side of a block's cells, and so of all fragments of its triangles. O(half-spaces).
  [[nodiscard]] Side SideOf(const volume::BlockLayout& layout, volume::BlockId id) const;
  // Returns the side of some cells.
  [[nodiscard]] Side SideOf(const math::IndexBox& cells) const;
  // Removes the blocks that are outside. O(rows of blocks + blocks of rows that are cut).
  void EraseOutside(const volume::BlockLayout& layout, volume::BlockSet* blocks) const;

  // Returns the signed distance of a vertex to a plane, scaled by the length of the normal.
  static double DistanceOf(const HalfSpace& half_space, const math::Vec3f& position) {
    return half_space.normal.x * static_cast<double>(position.x) +
           half_space.normal.y * static_cast<double>(position.y) +
           half_space.normal.z * static_cast<double>(position.z) - half_space.offset;
  }
  // Whether a fragment is kept, from the distances of the vertices of its triangle and its weights,
  // which are not negative.
  static bool IsKept(const std::array<double, 3>& distances, const std::array<double, 3>& weights) {
    return weights[0] * distances[0] + weights[1] * distances[1] + weights[2] * distances[2] >= 0;
  }

 private:
  std::vector<HalfSpace> half_spaces_;
  std::vector<double> margins_;  // of rounding, for each half-space
};

}  // namespace isoscope::view

#endif  // ISOSCOPE_CORE_VIEW_CLIP_REGION_H_
