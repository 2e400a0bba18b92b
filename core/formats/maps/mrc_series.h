// MRC files: maps of electron microscopy (MRC2014) and of crystallography (CCP4).

#ifndef ISOSCOPE_CORE_FORMATS_MAPS_MRC_SERIES_H_
#define ISOSCOPE_CORE_FORMATS_MAPS_MRC_SERIES_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/grid/grid_rules.h"
#include "core/source/volume_series.h"

namespace isoscope::source {

// True if a file begins so: "MAP" at byte 208, and a header that makes sense.
bool IsMrcHeader(absl::string_view head);

// Opens the file, compressed by gzip or not, as one field of that name. Its samples are those of
// modes 0 (int8; uint8 if IMOD says so), 1 (int16), 2 (float32), 6 (uint16) and 12 (float16, read
// as float32). The volumes of a map stack (space groups 401 to 630) are steps 0, 1, ...
//
// World positions follow the cell, in angstroms: columns, rows and sections run along the cell's
// axes that MAPC, MAPR and MAPS name, cell angles other than 90 degrees included. The first sample
// lies at ORIGIN or, if that is 0, at NSTART samples along the axes. A file without a cell has the
// spacing 1 and no unit. INVALID_ARGUMENT: no such header; another mode, with its name; axes that
// are no permutation; a cell, angles or an ORIGIN that are none, unless the rules take them; a
// stack that the volumes do not fill; the file is cut.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenMrcSeries(const std::string& file,
                                                            const std::string& field,
                                                            const GridRules& rules = {});

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_MAPS_MRC_SERIES_H_
