// A sweep is one request of a user for several frames:
//
//   --isovalue 20:100:10    9 frames, of 20, 30, ... 100
//   --step 0:10:5           the steps 0, 5 and 10, as far as they are served
//   --repeat 12 --orbit 30  12 frames of a camera that turns
//
// Isovalues are START + i * STEP, rounded to 15 digits, so that 0.1:0.3:0.1 has 0.3 and not
// 0.30000000000000004. The stop belongs to the sweep if it is a whole number of steps away, up to
// 1e-9. The number of steps is known only with the dataset: CheckUsage checks flags before the
// connection, ResolveSteps makes the list after it.

#include "clients/cpp/request/sweep_flags.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"

#include "clients/cpp/request/camera_flags.h"
#include "clients/cpp/request/parse_value.h"
#include "clients/cpp/request/selection_flags.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/usage.h"
#include "wire/proto_convert.h"

namespace isoscope::client {
namespace {

namespace v1 = isoscope::v1;

// A stop written in decimals is reached although its quotient is not whole in binary.
constexpr double kWholeTolerance = 1e-9;
constexpr double kMinFps = 0.1;
constexpr double kMaxFps = 120;

absl::StatusOr<std::int64_t> ParseFrameCount(absl::string_view text) {
  return ParseInteger(text, 1, kMaxFrameCount);
}

absl::StatusOr<double> ParseFps(absl::string_view text) {
  absl::StatusOr<double> fps = ParseNumber(text);
  if (!fps.ok() || *fps < kMinFps || *fps > kMaxFps) {
    return absl::InvalidArgumentError(absl::StrCat(
        "'", text, "' is not a number of frames a second, ", kMinFps, " to ", kMaxFps));
  }
  return fps;
}

constexpr int kMaxStep = std::numeric_limits<int>::max() - 1;

absl::StatusOr<StepName> ParseStepName(absl::string_view text) {
  if (text == "first") {
    return StepName{.kind = StepName::Kind::kFirst};
  }
  if (text == "last") {
    return StepName{.kind = StepName::Kind::kLast};
  }
  const absl::StatusOr<std::int64_t> number = ParseInteger(text, 0, kMaxStep);
  if (!number.ok()) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", text, "' is no step: a number from 0, first or last"));
  }
  return StepName{.number = static_cast<int>(*number)};
}

// The steps that a field or the dataset serves, ascending.
std::vector<int> ServedSteps(const v1::Dataset& dataset) {
  std::vector<int> numbers;
  for (const v1::TimeStep& step : dataset.time_steps()) {
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
  ISOSCOPE_ASSIGN_OR_RETURN(range.first, ParseStepName(parts[0]));
  if (parts.size() > 1) {
    ISOSCOPE_ASSIGN_OR_RETURN(range.last, ParseStepName(parts[1]));
  }
  if (parts.size() > 2) {
    const absl::StatusOr<std::int64_t> stride = ParseInteger(parts[2], -kMaxStep, kMaxStep);
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
  const std::int64_t stride = range.stride;
  const auto add = [&](std::int64_t step) {
    const bool is_within =
        stride > 0 ? first <= step && step <= last : last <= step && step <= first;
    if (is_within && (step - first) % stride == 0) {
      steps.push_back(static_cast<int>(step));
    }
  };
  // The range may be far longer than the list.
  if (stride > 0) {
    std::for_each(served.begin(), served.end(), add);
  } else {
    std::for_each(served.rbegin(), served.rend(), add);
  }
  if (steps.empty()) {
    return absl::InvalidArgumentError(absl::StrCat("--step names no step that is served: ", name,
                                                   " has ", served.front(), " to ", served.back()));
  }
  return steps;
}

absl::StatusOr<std::vector<int>> StepsOf(const StepRange& range, const v1::Dataset& dataset) {
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
    ISOSCOPE_ASSIGN_OR_RETURN(const double value, ParseNumber(text));
    return IsovalueRange{.first = value};
  }
  if (parts.size() != 3) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", text, "' is neither a number nor START:STOP:STEP"));
  }
  double values[3] = {};
  for (std::size_t k = 0; k < 3; ++k) {
    ISOSCOPE_ASSIGN_OR_RETURN(values[k], ParseNumber(parts[k]));
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

void AddSweepFlags(cli::FlagSet* set, SweepFlags* flags, RequestFlags* request) {
  set->Remove("--isovalue");
  const auto parse_isovalues = [flags, request](absl::string_view text) -> absl::Status {
    ISOSCOPE_ASSIGN_OR_RETURN(flags->isovalues, ParseIsovalues(text));
    request->isovalue = flags->isovalues->first;
    return absl::OkStatus();
  };
  set->Add("--isovalue", "V|A:B:STEP", parse_isovalues,
           "the isovalue, in field units; START:STOP:STEP renders a frame for each value");
  set->Remove("--step");
  const auto parse_steps = [flags, request](absl::string_view text) -> absl::Status {
    ISOSCOPE_ASSIGN_OR_RETURN(flags->step_range, ParseSteps(text));
    if (!flags->step_range->last) {
      ISOSCOPE_ASSIGN_OR_RETURN(request->selection.step, ParseStep(text));
    }
    return absl::OkStatus();
  };
  set->Add("--step", "N|first|last|A:B[:STRIDE]", parse_steps,
           "the time step, from 0 (default: last); A:B[:STRIDE] renders a frame for each step "
           "that is served")
      .Group("Field and time");
  cli::AddFlag(set, "--repeat", "N", &flags->repeat_count, ParseFrameCount,
               "frames to render, one request each (default: 1)");
  cli::AddFlag(set, "--orbit", "DEG", &flags->orbit_degrees, ParseNumber,
               "turn the camera about up after each frame (default: 0)");
  cli::AddFlag(set, "--fps", "N", &flags->frames_per_second, ParseFps,
               "frames a second of an animation, 0.1 to 120 (default: 12)");
}

absl::Status CheckUsage(const SweepFlags& flags, const SelectionFlags& selection) {
  if (flags.is_isovalue_sweep() && flags.repeat_count) {
    return cli::UsageError(
        absl::StrCat("--repeat can't be used with a sweep of isovalues, which has ",
                     flags.isovalues->count, " frames"));
  }
  if (flags.orbit_degrees && flags.frame_count() == 1 && !flags.is_step_sweep()) {
    return cli::UsageError(
        "--orbit turns the camera between frames: it needs --repeat N with N > 1, --isovalue "
        "START:STOP:STEP, or --step A:B");
  }
  if (flags.is_step_sweep() && (flags.is_isovalue_sweep() || flags.repeat_count)) {
    return cli::UsageError(absl::StrCat("--step A:B is a sweep of its own: leave ",
                                        flags.repeat_count ? "--repeat" : "the sweep of isovalues",
                                        " out"));
  }
  if (flags.is_step_sweep() && selection.time) {
    return cli::UsageError("--time and --step exclude each other: --step A:B names all steps");
  }
  return absl::OkStatus();
}

absl::Status ResolveSteps(const v1::Dataset& dataset, SweepFlags* flags) {
  if (flags->is_step_sweep()) {
    ISOSCOPE_ASSIGN_OR_RETURN(flags->steps, StepsOf(*flags->step_range, dataset));
  }
  return absl::OkStatus();
}

absl::Status SetFrame(const SweepFlags& flags, int i, v1::RenderIsosurfaceRequest* request) {
  if (flags.is_isovalue_sweep()) {
    const double isovalue = flags.isovalues->At(i);
    if (request->surfaces().empty()) {
      request->set_isovalue(isovalue);
    } else {
      request->mutable_surfaces(0)->set_isovalue(isovalue);  // labels follow it
    }
  }
  if (flags.is_step_sweep()) {
    request->mutable_selection()->set_time_step(flags.steps[static_cast<std::size_t>(i)]);
  }
  const double degrees = flags.orbit_degrees.value_or(0);
  if (i > 0 && degrees != 0) {
    // All values but the eye have the same bits as in the first camera.
    ISOSCOPE_ASSIGN_OR_RETURN(const view::Camera camera,
                              wire::CameraFromProto(request->camera(), "camera"));
    *request->mutable_camera()->mutable_eye() = wire::ToProto(OrbitCamera(camera, degrees, i).eye);
  }
  return absl::OkStatus();
}

}  // namespace isoscope::client
