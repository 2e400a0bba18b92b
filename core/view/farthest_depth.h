// Bounds how far away the fragments of a box of cells can be: the other end of
// Footprint::nearest_depth.

#ifndef ISOSCOPE_CORE_VIEW_FARTHEST_DEPTH_H_
#define ISOSCOPE_CORE_VIEW_FARTHEST_DEPTH_H_

#include "core/math/vec.h"
#include "core/view/view.h"

namespace isoscope::view {

// Returns a window depth that no fragment of the box between two positions in index space exceeds,
// at most 1: rounded away from the viewer, after the error that a float32 renderer makes in a
// vertex (docs/numerics.md, "Bounds of depth"). 1 for a box near the eye. Pure.
//
// footprint: view.FootprintOf(index_min, index_max), whose rectangle is not empty
float FarthestDepthOf(const View& view, const math::Vec3d& index_min, const math::Vec3d& index_max,
                      const Footprint& footprint);

}  // namespace isoscope::view

#endif  // ISOSCOPE_CORE_VIEW_FARTHEST_DEPTH_H_
