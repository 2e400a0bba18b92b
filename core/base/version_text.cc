// For what has no version of its own, such as a test. A linker leaves this out where a program brings the version of its
// commit (CMakeLists.txt).

#include "core/base/version.h"

namespace isoscope::base {

const char* const kVersionText = ISOSCOPE_PROJECT_VERSION;

}  // namespace isoscope::base
