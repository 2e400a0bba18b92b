// The length of vectors as a source: the components' sources, read side by side.

#ifndef ISOSCOPE_CORE_SOURCE_ADAPT_MAGNITUDE_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_ADAPT_MAGNITUDE_SOURCE_H_

#include <memory>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/volume_series.h"
#include "core/source/volume_source.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

// The sample type of the magnitude: float32 if it holds every value of every component (integers
// of 8 and 16 bits, float32), else float64. REQUIRES: at least one.
volume::ScalarType MagnitudeType(const std::vector<volume::ScalarType>& components);

// A source of sqrt(c0^2 + c1^2 + ...): squares, their sum in the order of the components and its
// root in double, rounded once to MagnitudeType. NaN, always the same bits, if a component is NaN;
// infinite where the sum is more than a double holds. The info is that of
// the first component beside the type; it is seekable if all are. Holds beside the components 256 Ki samples,
// or one row. Boxes are read if all components can: those of the coarser grid on each axis. Errors of
// reads are those of the components.
// REQUIRES: at least one component; all of one grid.
std::unique_ptr<VolumeSource> MakeMagnitudeSource(
    std::vector<std::unique_ptr<VolumeSource>> components);

// Opens a component of a field at a step; the one behind the last of several is their magnitude.
// Errors as VolumeSeries::Open. INVALID_ARGUMENT: components of a magnitude have other grids.
// REQUIRES: indices in range.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenComponent(VolumeSeries& series, int field,
                                                            int component, int step);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_ADAPT_MAGNITUDE_SOURCE_H_
