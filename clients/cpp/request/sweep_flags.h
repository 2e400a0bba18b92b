// Frames that differ in their isovalue, step or camera: `--isovalue A:B:STEP`, `--step A:B`,
// `--repeat`, `--orbit`.

#ifndef ISOSCOPE_CLIENTS_CPP_REQUEST_SWEEP_FLAGS_H_
#define ISOSCOPE_CLIENTS_CPP_REQUEST_SWEEP_FLAGS_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "clients/cpp/request/render_request.h"
#include "core/cli/flag_set.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::client {

// The most frames of one command.
inline constexpr std::int64_t kMaxFrameCount = 1'000'000;

// Isovalues at equal distances; one value is a range of one.
struct IsovalueRange {
  double first = 0;
  double step = 0;
  int count = 1;

  // Returns value i, with 15 significant digits: 0:1:0.1 has 0.3, as a user would type it.
  // REQUIRES: 0 <= i < count.
  [[nodiscard]] double At(int i) const;
};

// Parses "V", or "START:STOP:STEP" with a step other than 0 in the direction of STOP. If the step
// divides the range, STOP is the last value, else the last value lies before it. INVALID_ARGUMENT
// quotes the text and gives the allowed form.
absl::StatusOr<IsovalueRange> ParseIsovalues(absl::string_view text);

// A step by its number, or the first or last one that is served.
struct StepName {
  enum class Kind { kNumber, kFirst, kLast };
  Kind kind = Kind::kNumber;
  int number = 0;  // of kNumber
};

// One step, or all from `first` to `last` in strides.
struct StepRange {
  StepName first;
  std::optional<StepName> last = std::nullopt;  // not set: `first` alone
  int stride = 1;                               // not 0; negative: backwards
};

// "N", "first", "last", "A:B" or "A:B:STRIDE".
absl::StatusOr<StepRange> ParseSteps(absl::string_view text);

// The numbers of the steps that `range` names, of those that are served, which ascend: not all
// numbers between are. `name` is for messages. INVALID_ARGUMENT if none of those served is meant
// (says which are). REQUIRES: there are some.
absl::StatusOr<std::vector<int>> StepsOf(const StepRange& range, const std::vector<int>& served,
                                         const std::string& name);
// The same of a dataset; one without numbers of steps has step 0.
absl::StatusOr<std::vector<int>> StepsOf(const StepRange& range,
                                         const isoscope::v1::Dataset& dataset);

struct SweepFlags {
  std::optional<IsovalueRange> isovalues = std::nullopt;
  // --step with a range.
  std::optional<StepRange> step_range = std::nullopt;
  // Numbers of the steps to draw: set once the dataset is known (ResolveSteps). Empty: one step.
  std::vector<int> steps = {};
  std::optional<std::int64_t> repeat_count = std::nullopt;
  std::optional<double> orbit_degrees = std::nullopt;
  std::optional<double> frames_per_second = std::nullopt;

  [[nodiscard]] bool is_isovalue_sweep() const { return isovalues && isovalues->count > 1; }
  // Several steps, known or not yet.
  [[nodiscard]] bool is_step_sweep() const { return step_range && step_range->last; }
  // The frames show different things: several isovalues, steps or directions.
  [[nodiscard]] bool is_film() const {
    return is_isovalue_sweep() || is_step_sweep() || orbit_degrees.value_or(0) != 0;
  }
  [[nodiscard]] int frame_count() const;
  // The rate of an animation.
  [[nodiscard]] double fps() const { return frames_per_second.value_or(12); }
};

// Registers the flags. Takes over --isovalue, which AddRequestFlags has registered: its first value
// goes to `request`, so that the checks of a request hold. Takes over --step likewise, which may
// name several. Both must outlive the parsing.
void AddSweepFlags(cli::FlagSet* set, SweepFlags* flags, RequestFlags* request);

// UsageError if the flags do not fit each other, or name a step beside that of `selection`.
absl::Status CheckUsage(const SweepFlags& flags, const SelectionFlags& selection);

// Finds the steps of a sweep among those that the dataset serves. INVALID_ARGUMENT if there are
// none.
absl::Status ResolveSteps(const isoscope::v1::Dataset& dataset, SweepFlags* flags);

// Makes the request of the first frame that of frame i: its isovalue, its step, its eye.
// INVALID_ARGUMENT if the camera is wrong. REQUIRES: CheckUsage and ResolveSteps are OK,
// 0 <= i < frame_count.
absl::Status SetFrame(const SweepFlags& flags, int i,
                      isoscope::v1::RenderIsosurfaceRequest* request);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_REQUEST_SWEEP_FLAGS_H_
