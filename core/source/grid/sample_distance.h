// Errors about distances of samples that a header lacks, or that are not finite and above 0.

#ifndef ISOSCOPE_CORE_SOURCE_GRID_SAMPLE_DISTANCE_H_
#define ISOSCOPE_CORE_SOURCE_GRID_SAMPLE_DISTANCE_H_

#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace isoscope::source {

// INVALID_ARGUMENT unless `distance` is finite and above 0: names the field of the header, its
// value, and the flag that gives distances. "`path`: pixdim[3] is -2; ...".
absl::Status CheckSampleDistance(const std::string& path, absl::string_view field, double distance);

// INVALID_ARGUMENT: what the header has and what it lacks, and the flag. "`path`: PhysicalSizeX is
// 0.1, and there is no PhysicalSizeZ; ...". Without a path it is to follow a name and a colon.
absl::Status NoSampleDistance(absl::string_view path, absl::string_view what);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_GRID_SAMPLE_DISTANCE_H_
