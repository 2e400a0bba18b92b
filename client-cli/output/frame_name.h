// The names of the files that frames are written to: `--output turn-%03d.png`.
//
//   %d           the number of the frame, from 0
//   %03d, %3d    the same with leading zeros up to three digits, as in ffmpeg
//   %%           a percent sign, in a name with one of the above
//
// A name without a number is taken as it is, whatever percent signs it has.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_FRAME_NAME_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_FRAME_NAME_H_

#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace isoscope::cli {

// The name of frame `index` (>= 0).
std::string FrameFileName(absl::string_view pattern, int index);

// Whether frames have names of their own: `pattern` has a number.
bool HasFrameNumber(absl::string_view pattern);

// UsageError, with what was probably meant, for `--output PATTERN` that has a percent sign without
// a meaning beside a number; or in place of one where there are several frames, which would
// overwrite each other; or two numbers.
absl::Status CheckFrameName(absl::string_view pattern, int frame_count);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_FRAME_NAME_H_
