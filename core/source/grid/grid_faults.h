// The parts of a grid that the header of a file lacks, or has as numbers that are not finite. The
// flags --spacing, --direction and --origin give them in place of the file.

#ifndef ISOSCOPE_CORE_SOURCE_GRID_GRID_FAULTS_H_
#define ISOSCOPE_CORE_SOURCE_GRID_GRID_FAULTS_H_

#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

#include "core/source/grid/grid_rules.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::source {

// Each is an error if the file lacks it, and something else stands in its place: distances of 1,
// the axes of the world, an origin of 0.
struct GridFaults {
  absl::Status distances{};
  absl::Status directions{};
  absl::Status origin{};

  [[nodiscard]] bool ok() const { return distances.ok() && directions.ok() && origin.ok(); }
  // The errors for which the user gives nothing, in one sentence that names all their flags; `path`
  // is that of the errors.
  [[nodiscard]] absl::Status Check(const GridRules& rules, absl::string_view path) const;
};

// INVALID_ARGUMENT: what the header has, and the flag that gives it in its place, as
// NoSampleDistance. Without a path the message is to follow a name and a colon.
absl::Status NoDirections(absl::string_view path, absl::string_view what);
absl::Status NoOrigin(absl::string_view path, absl::string_view what);

// Finds distances that are not finite and above 0, directions that are not finite and independent,
// and an origin that is not finite. Puts the other ones in their place.
void ReplaceFaults(absl::string_view path, volume::GridGeometry* grid, GridFaults* faults);
// The same, and Check.
absl::Status TakeGridByRules(absl::string_view path, const GridRules& rules,
                             volume::GridGeometry* grid);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_GRID_GRID_FAULTS_H_
