// The names of frame files: `--output turn-%03d.png`.
//
//   %d           the number of the frame, from 0
//   %03d, %3d    the same with leading zeros up to three digits, as in ffmpeg
//   %%           a percent sign, in a name with one of the above
//
// A name without a number is used verbatim, with all its percent signs.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_FRAME_NAME_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_FRAME_NAME_H_

#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace isoscope::cli {

// The name of frame `index` (>= 0).
std::string FrameFileName(absl::string_view pattern, int index);

// Returns true if frames have names of their own: `pattern` has a number.
bool HasFrameNumber(absl::string_view pattern);

// UsageError for `--output PATTERN` with a percent sign that has no meaning beside a number, or
// stands in place of one although several frames would overwrite each other; or with two numbers.
// The message suggests the probable intent.
absl::Status CheckFrameName(absl::string_view pattern, int frame_count);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_FRAME_NAME_H_
