// Whether a point of a cell is inside the solid that the cell's triangles bound.

#ifndef ISOSCOPE_CORE_EXTRACT_CELL_INSIDE_H_
#define ISOSCOPE_CORE_EXTRACT_CELL_INSIDE_H_

#include <array>

#include "core/math/box.h"
#include "core/math/vec.h"
#include "core/volume/block_samples.h"
#include "core/volume/inside_rule.h"

namespace isoscope::extract {

// Returns true if the point is on the side of the inside corners. It follows the triangles of the
// case table, not the trilinear field, so that a cut that is filled by it meets the mesh. False in
// a cell that touches NaN, which has no triangles.
//
// samples:  by corner (case_table.h)
// cell:     its lowest sample, in index space: vertices are rounded as the mesh's are
// position: in index space, in the cell. Points within 1e-6 of its border count as if they were so
//           far inside; so do vertices within 1e-6 of a corner.
// isovalue: finite
bool IsInsideCell(const std::array<double, 8>& samples, const math::Index3& cell,
                  const math::Vec3d& position, double isovalue);
// Does the same for a rule. For labels it follows the triangles of label_case_table.h.
//
// REQUIRES: the rule is not smooth.
bool IsInsideCell(const std::array<double, 8>& samples, const math::Index3& cell,
                  const math::Vec3d& position, const volume::InsideRule& rule);
// Does the same for a smooth rule, whose vertices depend on the samples around the cell, too. A
// position outside of the cell counts as the nearest one within.
//
// REQUIRES: the cell is one of the block's own.
bool IsInsideSmoothCell(const volume::BlockSamples& samples, const math::IndexBox& stored,
                        const math::Index3& cell, const math::Vec3d& position,
                        const volume::InsideRule& rule);

}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_CELL_INSIDE_H_
