// Images of FITS files as volumes: cubes of astronomy.

#ifndef ISOSCOPE_CORE_FORMATS_ARRAYS_FITS_SERIES_H_
#define ISOSCOPE_CORE_FORMATS_ARRAYS_FITS_SERIES_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "core/source/grid/grid_rules.h"
#include "core/source/volume_series.h"

namespace isoscope::source {

// Opens the images of a file, plain or in a gzip stream, that are volumes: with three axes of more
// than one sample. A part names one, by EXTNAME in any case, or by its number from 0. Without one,
// fields are those that have the grid of the first; others are fields_elsewhere. A field has the
// name EXTNAME; else `field` in the first part, else its number.
//
// Samples are BZERO + BSCALE * stored, and NaN where an integer is BLANK. The grid is that of the
// world coordinates if its three axes are linear and of one unit; otherwise (angles on the sky,
// frequencies, velocities) samples are 1 apart, and `note` says so.
//
// NOT_FOUND: no such part (lists the images). INVALID_ARGUMENT: as ReadFitsFile; no volume; a
// compressed image; 64-bit integers that are scaled; numbers of the grid that make no sense.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenFitsSeries(const std::string& path,
                                                             const std::string& part,
                                                             const std::string& field,
                                                             const GridRules& rules = {});

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_ARRAYS_FITS_SERIES_H_
