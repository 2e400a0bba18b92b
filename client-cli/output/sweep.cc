#include "client-cli/output/sweep.h"

#include "absl/strings/str_cat.h"

#include "client-cli/output/frame_name.h"
#include "clients/cpp/picture_file/animation_writer.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/cli/format.h"
#include "core/cli/usage.h"

namespace isoscope::cli {
namespace {

// UsageError if `output` can't hold several frames, whose number may not be known yet.
absl::Status CheckSeveral(const std::string& output, int count, const std::string& what) {
  ISOSCOPE_RETURN_IF_ERROR(CheckFrameName(output, count));
  return HasFrameNumber(output)
             ? absl::OkStatus()
             : UsageError(absl::StrCat(what, ", but --output '", output,
                                       "' names one picture: put %d into the name, or write an "
                                       "animation: .apng or .webp"));
}

}  // namespace

absl::Status CheckUsage(const client::SweepFlags& flags, const client::SelectionFlags& selection,
                        const std::string& output) {
  ISOSCOPE_RETURN_IF_ERROR(client::CheckUsage(flags, selection));
  if (client::IsAnimationName(output)) {
    return HasFrameNumber(output)
               ? UsageError(absl::StrCat("--output '", output,
                                         "' is one file of all frames: leave the number out"))
               : absl::OkStatus();
  }
  if (flags.frames_per_second) {
    return UsageError(absl::StrCat("--fps is for an animation; --output '", output,
                                   "' is none: expected a name that ends in .apng or .webp"));
  }
  if (flags.is_step_sweep()) {
    constexpr int kSeveral = 2;
    return CheckSeveral(output, kSeveral, "--step names several steps");
  }
  if (flags.is_isovalue_sweep()) {
    return CheckSeveral(output, flags.frame_count(),
                        absl::StrCat("--isovalue has ", flags.isovalues->count, " values"));
  }
  return CheckFrameName(output, flags.frame_count());
}

std::string FormatFrameProgress(int done_count, int frame_count, absl::Duration elapsed) {
  std::string text = absl::StrCat("frame ", done_count, " of ", frame_count);
  if (done_count > 0) {
    absl::StrAppend(&text, "   ", FormatElapsed(elapsed * (frame_count - done_count) / done_count),
                    " left");
  }
  return text;
}

FrameProgress::FrameProgress(int frame_count, std::ostream* err, bool is_terminal)
    : frame_count_(frame_count),
      is_terminal_(is_terminal),
      start_(base::MonotonicNow()),
      line_(err, is_terminal) {}

void FrameProgress::Update(int done_count) {
  const absl::Duration elapsed = base::MonotonicNow() - start_;
  if (is_terminal_ && frame_count_ > 1 && elapsed > absl::Seconds(1)) {
    line_.Update(FormatFrameProgress(done_count, frame_count_, elapsed));
  }
}

}  // namespace isoscope::cli
