// The version of the whole project, as every program's --version prints it.

#ifndef ISOSCOPE_CORE_BASE_VERSION_H_
#define ISOSCOPE_CORE_BASE_VERSION_H_

#include "absl/strings/string_view.h"

namespace isoscope::base {

// Returns the version that scripts/version.sh says: "0.1.0", or "0.1.0+git12.gabcdef0" of a commit
// between two tags.
absl::string_view Version();

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_VERSION_H_
