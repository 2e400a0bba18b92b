// The samples at the corners of a cell, and the value between them.

#ifndef ISOSCOPE_CORE_VOLUME_CELL_SAMPLES_H_
#define ISOSCOPE_CORE_VOLUME_CELL_SAMPLES_H_

#include <array>

#include "core/math/box.h"
#include "core/math/vec.h"
#include "core/volume/block_samples.h"

namespace isoscope::volume {

// Returns the samples of a cell. Corner c lies at cell + (c & 1, c >> 1 & 1, c >> 2).
//
// stored: the samples that the block stores
// cell:   its lowest sample, in index space. REQUIRES: all corners are stored.
std::array<double, 8> SamplesOfCell(const BlockSamples& samples, const math::IndexBox& stored,
                                    const math::Index3& cell);

// Returns the trilinear value at a position, which is moved into the cell if it lies outside.
// Corners of weight 0 are left out, so that a NaN or an infinity there does not count.
//
// position: in index space
double ValueInCell(const std::array<double, 8>& corners, const math::Index3& cell,
                   const math::Vec3d& position);

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_CELL_SAMPLES_H_
