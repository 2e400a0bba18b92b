// The grid of an NRRD header: three axes of space among its axes.

#ifndef ISOSCOPE_CORE_FORMATS_MEDICAL_NRRD_GRID_H_
#define ISOSCOPE_CORE_FORMATS_MEDICAL_NRRD_GRID_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/bytes/text_header.h"
#include "core/source/grid/grid_faults.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/patient_frame.h"

namespace isoscope::source {

// "(1,0,0) none (0,0,2)" or "none 1 0.5" in parts; those in parentheses and in quotation marks
// stay together, without the latter.
std::vector<std::string> SplitNrrdList(absl::string_view text);

// The lists of a header that have one entry for each axis; empty if the header has no such list.
struct NrrdAxisLists {
  std::vector<std::int64_t> sizes{};
  std::vector<std::string> kinds{};
  std::vector<std::string> directions{};
  std::vector<std::string> spacings{};
  std::vector<std::string> mins{};
  std::vector<std::string> maxs{};
  std::vector<std::string> centers{};
  std::vector<std::string> units{};
};
// INVALID_ARGUMENT: a size below 1; a list of another length.
absl::StatusOr<NrrdAxisLists> ReadNrrdLists(const HeaderFields& fields, const std::string& path);

// Returns true if an axis of that kind may be one of space: "domain", "space", or none that is
// known.
bool IsNrrdKindOfSpace(absl::string_view kind);
// Returns true if an axis is one of space, by its direction, else by its kind.
bool IsNrrdAxisOfSpace(const NrrdAxisLists& lists, std::size_t axis);
// The number of a list, NaN if there is no such list or it is none.
double NrrdNumber(const std::vector<std::string>& list, std::size_t axis);

struct NrrdGrid {
  volume::GridGeometry geometry{};  // in LPS where the space says how it lies in the patient
  std::optional<volume::PatientFrame> patient_frame{};
  std::string length_unit{};  // of all three axes; may be empty
  // The time of the origin and its unit, in a space with time.
  double first_time = 0;
  std::string time_unit{};
  GridFaults faults{};  // as in FileLayout
};

// The grid of the axes from `first` on. Without a direction, a spacing, and bounds (axis mins and
// maxs) of any axis, samples are 1 apart. An axis whose direction is "none" is a fault.
// INVALID_ARGUMENT: texts that are no numbers; two sources that contradict each other; a
// left-handed space, or one that is not of three dimensions (and time); volume::Validate. REQUIRES:
// three axes from there on.
absl::StatusOr<NrrdGrid> ReadNrrdGrid(const HeaderFields& fields, const NrrdAxisLists& lists,
                                      std::size_t first, const std::string& path);

absl::Status NrrdError(const std::string& path, absl::string_view what);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_MEDICAL_NRRD_GRID_H_
