// The array of a VTK ImageData file that becomes a volume, and its type.

#ifndef ISOSCOPE_CORE_FORMATS_VTK_VTI_CHOICE_H_
#define ISOSCOPE_CORE_FORMATS_VTK_VTI_CHOICE_H_

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"

#include "core/formats/vtk/vti_header.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

// An array and one of its components.
struct VtiChoice {
  VtiArray array;
  std::int64_t component = 0;
};

// The array that `part` names ("velocity", or "velocity:2" for one of its components, counted from
// 0), points before cells. Without a part: the first array of one component, points before cells,
// and of either that which the file calls its scalars. `path` is for messages. NOT_FOUND: no such
// array. INVALID_ARGUMENT: no array; several components and none chosen; no such component. All
// three list the arrays and the argument to give.
absl::StatusOr<VtiChoice> ChooseVtiArray(const VtiHeader& header, const std::string& part,
                                         const std::string& path);

// Returns true if an array may be the default: one component, of a type that volumes have. VTK
// marks ghost points and cells in an array of its own, which may not.
bool IsDefaultVtiArray(const VtiArray& array);

// INVALID_ARGUMENT: a type that no volume has.
absl::StatusOr<volume::ScalarType> VtiTypeOf(const VtiArray& array, const std::string& path);
// True if a volume can have the type, or it is Int64 or UInt64 (wide_source.h).
bool IsVtiNumber(const std::string& type);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_VTK_VTI_CHOICE_H_
