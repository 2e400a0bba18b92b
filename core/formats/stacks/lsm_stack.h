// The private tag of Zeiss LSM files, which are TIFF.

#ifndef ISOSCOPE_CORE_FORMATS_STACKS_LSM_STACK_H_
#define ISOSCOPE_CORE_FORMATS_STACKS_LSM_STACK_H_

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/grid/stack_layout.h"

namespace isoscope::source {

// Parses CZ_LSMINFO. A page holds the planes of all channels; slices are faster than steps. Voxels
// are in micrometres, times in seconds. INVALID_ARGUMENT: no such tag, or sizes that make no stack.
// The message is to follow a name and a colon.
absl::StatusOr<StackLayout> ParseLsm(absl::string_view info);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_STACKS_LSM_STACK_H_
