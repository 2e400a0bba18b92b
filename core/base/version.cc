#include "core/base/version.h"

namespace isoscope::base {

absl::string_view Version() { return kVersionText; }

}  // namespace isoscope::base
