// Legacy VTK files (.vtk) of structured points and rectilinear grids.

#ifndef ISOSCOPE_CORE_FORMATS_VTK_LEGACY_VTK_SERIES_H_
#define ISOSCOPE_CORE_FORMATS_VTK_LEGACY_VTK_SERIES_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "core/source/grid/grid_rules.h"
#include "core/source/volume_series.h"

namespace isoscope::source {

// Opens the file, binary or text, versions 1 to 5. Its fields are the arrays of points or, if none
// of those has numbers, of cells, whose samples lie at the cells' centres. Vectors, normals,
// tensors and texture coordinates are fields of several components. Colours, tables of colours and
// arrays of text or bits are passed over. 64-bit integers become float64 (wide_source.h). The step
// has the time of the field data's array TIME or TimeValue. Files of text are read through once
// here, to find where arrays begin.
//
// INVALID_ARGUMENT: no such file; another kind of dataset (names it, and says what to do); a
// rectilinear grid that is not even, unless the rules resample (legacy_vtk_grid.h); no array
// of numbers, or two of one name; sizes that do not fit; the file ends early. `field` is not used.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenLegacyVtkSeries(const std::string& file,
                                                                  const std::string& field,
                                                                  const GridRules& rules = {});

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_VTK_LEGACY_VTK_SERIES_H_
