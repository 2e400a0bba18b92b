// The flags of a user for readers. --ignore-shear, --resample, --spacing, --origin and --direction
// allow grids that readers refuse otherwise; --series chooses a series.

#ifndef ISOSCOPE_CORE_SOURCE_GRID_GRID_RULES_H_
#define ISOSCOPE_CORE_SOURCE_GRID_GRID_RULES_H_

#include <optional>
#include <string>

namespace isoscope::source {

// By default a reader refuses all these kinds of grid.
struct GridRules {
  // A sheared transform is read as it is; AdjustSource makes it straight.
  bool ignores_shear = false;
  // Samples at uneven distances are resampled (resampled_source.h) after those of the value `fill`
  // have become NaN, so that no value is mixed with it.
  bool resamples = false;
  std::optional<double> fill{};
  // The distances of samples are given: a reader takes 1 where those of the file are missing or
  // make no sense. So are the place of the first sample, and the directions of the axes: a reader
  // takes 0 and the axes of the world (grid_faults.h).
  bool has_spacing = false;
  bool has_origin = false;
  bool has_direction = false;
  // The number or UID of the DICOM series among those that a path names; empty: the only one.
  std::string dicom_series{};
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_GRID_GRID_RULES_H_
