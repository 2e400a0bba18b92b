#include "client-cli/output/sweep.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"

#include "client-cli/output/frame_name.h"
#include "clients/cpp/picture_file/animation_writer.h"
#include "clients/cpp/request/parse_value.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/format.h"
#include "core/cli/usage.h"

namespace isoscope::cli {
namespace {

// A stop written in decimals is reached although its quotient is not whole in binary.
constexpr double kWholeTolerance = 1e-9;
constexpr double kMinFps = 0.1;
constexpr double kMaxFps = 120;

absl::StatusOr<std::int64_t> ParseFrameCount(absl::string_view text) {
  return client::ParseInteger(text, 1, kMaxFrameCount);
}

absl::StatusOr<double> ParseFps(absl::string_view text) {
  absl::StatusOr<double> fps = client::ParseNumber(text);
  if (!fps.ok() || *fps < kMinFps || *fps > kMaxFps) {
    return absl::InvalidArgumentError(absl::StrCat(
        "'", text, "' is not a number of frames a second, ", kMinFps, " to ", kMaxFps));
  }
  return fps;
}

constexpr int kMaxStep = std::numeric_limits<int>::max() - 1;

absl::StatusOr<StepName> ParseStep(absl::string_view text) {
  if (text == "first") {
    return StepName{.kind = StepName::Kind::kFirst};
  }
  if (text == "last") {
    return StepName{.kind = StepName::Kind::kLast};
  }
  const absl::StatusOr<std::int64_t> number = client::ParseInteger(text, 0, kMaxStep);
  if (!number.ok()) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", text, "' is no step: a number from 0, first or last"));
  }
  return StepName{.number = static_cast<int>(*number)};
}

// The steps that a field or the dataset serves, ascending.
std::vector<int> ServedSteps(const isoscope::v1::Dataset& dataset) {
  std::vector<int> numbers;
  for (const isoscope::v1::TimeStep& step : dataset.time_steps()) {
    numbers.push_back(step.number());
  }
  std::sort(numbers.begin(), numbers.end());
  return numbers;
}

int NumberOf(const StepName& name, const std::vector<int>& served) {
  switch (name.kind) {
    case StepName::Kind::kFirst:
      return served.front();
    case StepName::Kind::kLast:
      return served.back();
    case StepName::Kind::kNumber:
      break;
  }
  return name.number;
}

}  // namespace

absl::StatusOr<StepRange> ParseSteps(absl::string_view text) {
  const std::vector<absl::string_view> parts = absl::StrSplit(text, ':');
  if (parts.size() > 3) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", text, "' is not N, first, last, A:B or A:B:STRIDE"));
  }
  StepRange range;
  ISOSCOPE_ASSIGN_OR_RETURN(range.first, ParseStep(parts[0]));
  if (parts.size() > 1) {
    ISOSCOPE_ASSIGN_OR_RETURN(range.last, ParseStep(parts[1]));
  }
  if (parts.size() > 2) {
    const absl::StatusOr<std::int64_t> stride = client::ParseInteger(parts[2], -kMaxStep, kMaxStep);
    if (!stride.ok() || *stride == 0) {
      return absl::InvalidArgumentError(
          absl::StrCat("'", parts[2], "' is no stride: a whole number other than 0"));
    }
    range.stride = static_cast<int>(*stride);
  }
  return range;
}

absl::StatusOr<std::vector<int>> StepsOf(const StepRange& range, const std::vector<int>& served,
                                         const std::string& name) {
  const int first = NumberOf(range.first, served);
  if (!range.last) {
    return std::vector<int>{first};  // whoever has the steps says if it is not served
  }
  const int last = NumberOf(*range.last, served);
  std::vector<int> steps;
  if ((last - first) / std::abs(range.stride) * (range.stride > 0 ? 1 : -1) >= 0) {
    for (std::int64_t step = first; range.stride > 0 ? step <= last : step >= last;
         step += range.stride) {
      if (std::binary_search(served.begin(), served.end(), static_cast<int>(step))) {
        steps.push_back(static_cast<int>(step));
      }
    }
  }
  if (steps.empty()) {
    return absl::InvalidArgumentError(absl::StrCat("--step names no step that is served: ", name,
                                                   " has ", served.front(), " to ", served.back()));
  }
  return steps;
}

absl::StatusOr<std::vector<int>> StepsOf(const StepRange& range,
                                         const isoscope::v1::Dataset& dataset) {
  std::vector<int> served = ServedSteps(dataset);
  if (served.empty()) {
    served = {0};
  }
  return StepsOf(range, served, absl::StrCat("dataset \"", dataset.name(), "\""));
}

double IsovalueRange::At(int i) const {
  if (i == 0) {
    return first;
  }
  double value = 0;
  // Always parses: the text was printed from a number.
  return absl::SimpleAtod(absl::StrFormat("%.15g", first + i * step), &value) ? value : first;
}

absl::StatusOr<IsovalueRange> ParseIsovalues(absl::string_view text) {
  const std::vector<absl::string_view> parts = absl::StrSplit(text, ':');
  if (parts.size() == 1) {
    ISOSCOPE_ASSIGN_OR_RETURN(const double value, client::ParseNumber(text));
    return IsovalueRange{.first = value};
  }
  if (parts.size() != 3) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", text, "' is neither a number nor START:STOP:STEP"));
  }
  double values[3] = {};
  for (std::size_t k = 0; k < 3; ++k) {
    ISOSCOPE_ASSIGN_OR_RETURN(values[k], client::ParseNumber(parts[k]));
  }
  const auto [start, stop, step] = values;
  const double steps = (stop - start) / step;
  if (step == 0 || !(steps >= 0)) {
    return absl::InvalidArgumentError(absl::StrCat(
        "'", text, "': the step ", parts[2], " does not lead from ", parts[0], " to ", parts[1]));
  }
  if (steps >= static_cast<double>(kMaxFrameCount)) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", text, "' has more than ", kMaxFrameCount, " isovalues"));
  }
  const double count = std::floor(steps * (1 + kWholeTolerance) + kWholeTolerance) + 1;
  return IsovalueRange{.first = start, .step = step, .count = static_cast<int>(count)};
}

int SweepFlags::frame_count() const {
  if (is_step_sweep()) {
    return std::max(1, static_cast<int>(steps.size()));
  }
  return is_isovalue_sweep() ? isovalues->count : static_cast<int>(repeat_count.value_or(1));
}

void AddSweepFlags(FlagSet* set, SweepFlags* flags, client::RequestFlags* request) {
  set->Remove("--isovalue");
  const auto parse_isovalues = [flags, request](absl::string_view text) -> absl::Status {
    ISOSCOPE_ASSIGN_OR_RETURN(flags->isovalues, ParseIsovalues(text));
    request->isovalue = flags->isovalues->first;
    return absl::OkStatus();
  };
  set->Add("--isovalue", "V|A:B:STEP", parse_isovalues,
           "the level, in field units; START:STOP:STEP renders a frame for each level");
  set->Remove("--step");
  const auto parse_steps = [flags, request](absl::string_view text) -> absl::Status {
    ISOSCOPE_ASSIGN_OR_RETURN(flags->step_range, ParseSteps(text));
    if (!flags->step_range->last) {
      ISOSCOPE_ASSIGN_OR_RETURN(request->selection.step, client::ParseStep(text));
    }
    return absl::OkStatus();
  };
  set->Add("--step", "N|first|last|A:B[:STRIDE]", parse_steps,
           "the time step, from 0 (default: last); A:B[:STRIDE] renders a frame for each step "
           "that is served")
      .Group("Field and time");
  AddFlag(set, "--repeat", "N", &flags->repeat_count, ParseFrameCount,
          "frames to render, one request each (default: 1)");
  AddFlag(set, "--orbit", "DEG", &flags->orbit_degrees, client::ParseNumber,
          "turn the camera about up after each frame (default: 0)");
  AddFlag(set, "--fps", "N", &flags->frames_per_second, ParseFps,
          "frames a second of an animation, 0.1 to 120 (default: 12)");
}

namespace {

// A sweep of steps, whose number is not known yet.
absl::Status CheckStepSweep(const SweepFlags& flags, const std::string& output) {
  if (flags.is_isovalue_sweep() || flags.repeat_count) {
    return UsageError(absl::StrCat("--step A:B is a sweep of its own: leave ",
                                   flags.repeat_count ? "--repeat" : "the sweep of isovalues",
                                   " out"));
  }
  constexpr int kSeveral = 2;
  if (client::IsAnimationName(output)) {
    return absl::OkStatus();
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckFrameName(output, kSeveral));
  return HasFrameNumber(output)
             ? absl::OkStatus()
             : UsageError(absl::StrCat("--step names several steps, but --output '", output,
                                       "' names one picture: put %d into the name, or write an "
                                       "animation: .apng or .webp"));
}

}  // namespace

absl::Status ResolveSteps(const isoscope::v1::Dataset& dataset, SweepFlags* flags) {
  if (flags->is_step_sweep()) {
    ISOSCOPE_ASSIGN_OR_RETURN(flags->steps, StepsOf(*flags->step_range, dataset));
  }
  return absl::OkStatus();
}

absl::Status CheckUsage(const SweepFlags& flags, const std::string& output) {
  if (flags.is_isovalue_sweep() && flags.repeat_count) {
    return UsageError(absl::StrCat("--repeat can't be used with a sweep of isovalues, which has ",
                                   flags.isovalues->count, " frames"));
  }
  if (flags.orbit_degrees && flags.frame_count() == 1 && !flags.is_step_sweep()) {
    return UsageError(
        "--orbit turns the camera between frames: it needs --repeat N with N > 1, --isovalue "
        "START:STOP:STEP, or --step A:B");
  }
  if (flags.frames_per_second && !client::IsAnimationName(output)) {
    return UsageError(absl::StrCat("--fps is for an animation; --output '", output,
                                   "' is none: expected a name that ends in .apng or .webp"));
  }
  if (flags.is_step_sweep() && (flags.is_isovalue_sweep() || flags.repeat_count)) {
    return CheckStepSweep(flags, output);
  }
  if (client::IsAnimationName(output)) {
    return HasFrameNumber(output)
               ? UsageError(absl::StrCat("--output '", output,
                                         "' is one file of all frames: leave the number out"))
               : absl::OkStatus();
  }
  if (flags.is_step_sweep()) {
    return CheckStepSweep(flags, output);
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckFrameName(output, flags.frame_count()));
  if (flags.is_isovalue_sweep() && !HasFrameNumber(output)) {
    return UsageError(absl::StrCat("--isovalue has ", flags.isovalues->count,
                                   " values, but --output '", output,
                                   "' names one picture: put %d into the name, or write an "
                                   "animation: .apng or .webp"));
  }
  return absl::OkStatus();
}

client::RequestFlags RequestOfFrame(const SweepFlags& flags, const client::RequestFlags& request,
                                    int i) {
  client::RequestFlags frame_flags = request;
  if (flags.is_isovalue_sweep()) {
    frame_flags.isovalue = flags.isovalues->At(i);
  }
  return frame_flags;
}

view::Camera CameraOfFrame(const SweepFlags& flags, const view::Camera& camera, int i) {
  return client::OrbitCamera(camera, flags.orbit_degrees.value_or(0), i);
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
