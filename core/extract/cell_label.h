// The label that a point of a surface of labels belongs to, for picks.

#ifndef ISOSCOPE_CORE_EXTRACT_CELL_LABEL_H_
#define ISOSCOPE_CORE_EXTRACT_CELL_LABEL_H_

#include <array>
#include <optional>

#include "core/math/vec.h"
#include "core/volume/inside_rule.h"

namespace isoscope::extract {

// Returns the sample at the inside end of the cell's crossed edge whose middle, which is a vertex,
// is nearest to the point; of several the one with the lowest number (case_table.h). Nothing if the
// surface does not pass through the cell, or a sample of it is NaN.
//
// samples:  by corner (case_table.h)
// cell:     its lowest sample, in index space
// position: in index space, where distances are taken; should be in the cell
// REQUIRES: the rule has labels.
std::optional<double> LabelInCell(const std::array<double, 8>& samples, const math::Index3& cell,
                                  const math::Vec3d& position, const volume::InsideRule& rule);

}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_CELL_LABEL_H_
