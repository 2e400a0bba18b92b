// The version of binaries that have none of their own, such as tests. A program's Version()
// replaces this one (CMakeLists.txt).

#include "core/base/version.h"

#include "absl/base/attributes.h"

namespace isoscope::base {

ABSL_ATTRIBUTE_WEAK absl::string_view Version() { return ISOSCOPE_PROJECT_VERSION; }

}  // namespace isoscope::base
