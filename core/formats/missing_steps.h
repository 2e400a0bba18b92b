// Steps that a source had once.

#ifndef ISOSCOPE_CORE_FORMATS_MISSING_STEPS_H_
#define ISOSCOPE_CORE_FORMATS_MISSING_STEPS_H_

#include <string>

#include "core/formats/open_request.h"

namespace isoscope::source {

// Says in a sentence without its end that a source, which has `step_count` steps, had `least_count`
// or more: of files by number, which ones are missing, where their names tell.
std::string DescribeMissingSteps(const OpenRequest& request, int step_count, int least_count);

// Says in a sentence without its end which files a source of `step_count` steps does not have between
// the first and the last: "there is no run_2.vti". "" if its files are no steps, or their names don't
// tell.
std::string DescribeGap(const OpenRequest& request, int step_count);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_MISSING_STEPS_H_
