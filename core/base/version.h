// The version of the whole project, as every program's --version prints it.

#ifndef ISOSCOPE_CORE_BASE_VERSION_H_
#define ISOSCOPE_CORE_BASE_VERSION_H_

#include "absl/strings/string_view.h"

namespace isoscope::base {

// Returns the version of CMake's project(): "0.1.0".
absl::string_view Version();

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_VERSION_H_
