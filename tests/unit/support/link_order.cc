#include "tests/unit/support/link_order.h"

namespace isoscope::testing {

const char* WhoCompiledItForTheProduct() { return WhoCompiledIt(); }

}  // namespace isoscope::testing
