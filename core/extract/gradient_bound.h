// The longest gradient in a block, which bounds those of its vertices.
//
// A vertex has the gradients of the two samples of its edge, interpolated by a t in [0, 1]: a
// convex combination, which is at most as long as the longer of the two. A point of a triangle has
// the lengths of its three vertices, interpolated with weights that are not negative and add up to
// 1: at most the longest. So the maximum over all samples bounds them all, except for rounding
// (docs/numerics.md, "Gradient magnitude").

#ifndef ISOSCOPE_CORE_EXTRACT_GRADIENT_BOUND_H_
#define ISOSCOPE_CORE_EXTRACT_GRADIENT_BOUND_H_

#include "core/math/box.h"
#include "core/math/matrix.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_samples.h"

namespace isoscope::extract {

// Returns the largest length of the gradient at the samples of `box`, in field units per world
// unit, by the differences that normals are made from; lengths that are not finite are left out.
// `so_far` if none is larger than that. The same for any cut of the volume. Thread-safe.
// O(samples), and fast where the block's range of values rules out a larger one.
//
// world_gradient_from_index: GridGeometry::world_gradient_from_index()
// box:                       in the volume; within layout.OwnSamplesOf(samples.block_id)
// so_far:                    >= 0
double MaxGradientMagnitude(const volume::BlockLayout& layout,
                            const math::Mat3d& world_gradient_from_index,
                            const volume::BlockSamples& samples, const math::IndexBox& box,
                            double so_far);

}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_GRADIENT_BOUND_H_
