#include "core/source/grid/sample_distance.h"

#include <cmath>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace isoscope::source {

absl::Status CheckSampleDistance(const std::string& path, absl::string_view field,
                                 double distance) {
  return std::isfinite(distance) && distance > 0
             ? absl::OkStatus()
             : NoSampleDistance(path, absl::StrFormat("%s is %g", field, distance));
}

absl::Status NoSampleDistance(absl::string_view path, absl::string_view what) {
  return absl::InvalidArgumentError(
      absl::StrCat(path, path.empty() ? "" : ": ", what,
                   "; expected distances of samples above 0 along all axes: give them in place of "
                   "those of the file, --spacing X,Y,Z"));
}

}  // namespace isoscope::source
