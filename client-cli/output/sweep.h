// The files of frames, and how far they are. The frames themselves are those of
// clients/cpp/request/sweep_flags.h.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_SWEEP_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_SWEEP_H_

#include <iosfwd>
#include <string>

#include "absl/status/status.h"
#include "absl/time/time.h"

#include "clients/cpp/request/sweep_flags.h"
#include "core/base/monotonic_time.h"
#include "core/cli/progress_line.h"

namespace isoscope::cli {

// UsageError if the flags do not fit each other, a step beside that of `selection`, or the name of
// the output (CheckFrameName): a sweep of isovalues needs a name with a number in it, or that of an
// animation; --fps needs an animation.
absl::Status CheckUsage(const client::SweepFlags& flags, const client::SelectionFlags& selection,
                        const std::string& output);

// "frame 12 of 72   4 s left": `done_count` frames took `elapsed`.
std::string FormatFrameProgress(int done_count, int frame_count, absl::Duration elapsed);

// Shows the progress of a sweep on a terminal, once it has taken a second. No output otherwise.
// Thread-compatible.
class FrameProgress {
 public:
  // `err` must outlive it.
  FrameProgress(int frame_count, std::ostream* err, bool is_terminal);

  void Update(int done_count);

 private:
  const int frame_count_;
  const bool is_terminal_;
  const base::MonotonicTime start_;
  ProgressLine line_;
};

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_SWEEP_H_
