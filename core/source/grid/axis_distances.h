// Where the samples of a grid lie whose axes need not be even.

#ifndef ISOSCOPE_CORE_SOURCE_GRID_AXIS_DISTANCES_H_
#define ISOSCOPE_CORE_SOURCE_GRID_AXIS_DISTANCES_H_

#include <array>
#include <vector>

namespace isoscope::source {

// The places of the samples along each axis, in world units from the first one on, which is at 0.
// Empty: the axis is even, and stays as it is.
using AxisDistances = std::array<std::vector<double>, 3>;

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_GRID_AXIS_DISTANCES_H_
