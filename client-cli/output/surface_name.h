// The names of mesh files, one for each surface: `--output label-%l.stl`.
//
//   %l           the label of the surface: 7; 3+7-9 for a set; of an isovalue, the isovalue
//   %03l         the same with leading zeros, of a single label that is a whole number
//   %n           the name of the label; '_' stands for all but letters, digits, '.', '-' and '_'
//   %%           a percent sign, in a name with one of the above
//
// A name without %l and %n is used verbatim, and holds all surfaces.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_SURFACE_NAME_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_SURFACE_NAME_H_

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::cli {

// A surface, as names of files tell it.
struct NamedSurface {
  std::vector<double> labels = {};  // ascending; empty: that of an isovalue
  double isovalue = 0;
  std::string name = {};  // of the labels
};

// Returns true if surfaces have files of their own: the pattern has %l or %n.
bool HasSurfaceName(absl::string_view pattern);

// UsageError for a percent sign that has no meaning beside %l or %n.
absl::Status CheckSurfaceName(absl::string_view pattern);

// Returns the name of each surface's file. INVALID_ARGUMENT: two would have one name, or one is
// longer than a file's name may be. REQUIRES: CheckSurfaceName is OK.
absl::StatusOr<std::vector<std::string>> SurfaceFileNames(
    absl::string_view pattern, const std::vector<NamedSurface>& surfaces);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_SURFACE_NAME_H_
