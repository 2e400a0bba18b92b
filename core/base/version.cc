#include "core/base/version.h"

namespace isoscope::base {

absl::string_view Version() { return ISOSCOPE_VERSION; }

}  // namespace isoscope::base
