// For what has no version of its own, such as a test. A program's Version() takes the place of this
// one (CMakeLists.txt).

#include "core/base/version.h"

#include "absl/base/attributes.h"

namespace isoscope::base {

ABSL_ATTRIBUTE_WEAK absl::string_view Version() { return ISOSCOPE_PROJECT_VERSION; }

}  // namespace isoscope::base
