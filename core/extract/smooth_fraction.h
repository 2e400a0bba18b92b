// Where the vertices of a smooth surface of labels lie on their grid edges.
//
// Each sample has a share of a label: how much of the 27 samples around has it, with weights 1 2 1
// along each axis. Between two neighbours with labels p and q, the vertex lies where the share of p
// equals that of q, if shares change linearly along the edge:
//
//   d(s) = share of p - share of q at sample s
//   t    = d(lower) / (d(lower) - d(upper)), from 1/4 to 3/4
//
// Samples alone decide it: not the labels of the surface, nor the block. So surfaces of neighbouring
// labels keep their common vertices, and blocks theirs: an own edge needs one layer of ghosts.
// docs/numerics.md, "Smooth labels", has the cases where d does not fall through 0.

#ifndef ISOSCOPE_CORE_EXTRACT_SMOOTH_FRACTION_H_
#define ISOSCOPE_CORE_EXTRACT_SMOOTH_FRACTION_H_

#include <cstdint>
#include <span>

#include "core/math/box.h"
#include "core/math/vec.h"
#include "core/volume/block_samples.h"

namespace isoscope::extract {

// Returns t of the vertex on the edge from sample `lower` of the volume along `axis`, in [1/4, 3/4].
// Where the volume ends, the nearest sample on each axis counts in place of one outside.
//
// stored: the block's samples with ghosts, in the volume
//
// REQUIRES: both ends are own samples of the block, and differ.
double SmoothFraction(const volume::BlockSamples& samples, const math::IndexBox& stored,
                      const math::Index3& lower, int axis);

// Does the same for many edges along one axis.
//
// dims:          of the stored samples
// lower_samples: the lower end of each edge, as an index into the stored samples
// fractions:     capacity of lower_samples.size()
void FillSmoothFractions(const volume::BlockSamples& samples, const math::Index3& dims, int axis,
                         std::span<const std::uint32_t> lower_samples, double* fractions);

}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_SMOOTH_FRACTION_H_
