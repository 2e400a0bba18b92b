#include "clients/cpp/request/field_flags.h"

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <limits>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

#include "clients/cpp/request/parse_value.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/usage.h"

namespace isoscope::client {
namespace {

constexpr int kMaxStep = std::numeric_limits<int>::max() - 1;

absl::StatusOr<StepName> ParseStep(absl::string_view text) {
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

// Null if the dataset has no such field.
const isoscope::v1::Field* FindField(const isoscope::v1::Dataset& dataset,
                                     const std::string& name) {
  for (const isoscope::v1::Field& field : dataset.fields()) {
    if (field.name() == name || name.empty()) {
      return &field;
    }
  }
  return nullptr;
}

absl::StatusOr<StepRange> ParseOneStep(absl::string_view text) {
  ISOSCOPE_ASSIGN_OR_RETURN(const StepName step, ParseStep(text));
  return StepRange{.first = step};
}

}  // namespace

absl::StatusOr<FieldName> ParseFieldName(absl::string_view text) {
  const std::size_t colon = text.rfind(':');
  FieldName name;
  name.field = std::string(text.substr(0, colon));
  if (colon != absl::string_view::npos) {
    name.component = std::string(text.substr(colon + 1));
  }
  if (name.field.empty() || (colon != absl::string_view::npos && name.component.empty())) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", text, "' is not NAME or NAME:COMPONENT, as pressure or velocity:x"));
  }
  return name;
}

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
    const absl::StatusOr<std::int64_t> stride = ParseInteger(parts[2], -kMaxStep, kMaxStep);
    if (!stride.ok() || *stride == 0) {
      return absl::InvalidArgumentError(
          absl::StrCat("'", parts[2], "' is no stride: a whole number other than 0"));
    }
    range.stride = static_cast<int>(*stride);
  }
  return range;
}

void AddFieldFlags(cli::FlagSet* set, FieldFlags* flags, bool has_sweep) {
  const std::string group = "Field and time";
  cli::AddFlag(set, "--field", "NAME[:x|y|z|N|magnitude]", &flags->field, ParseFieldName,
               "the field whose level --isovalue is, and its component (default: the first field; "
               "of several components, the magnitude; `isoscope info` lists them)")
      .Group(group);
  cli::AddFlag(set, "--time", "VALUE", &flags->time, ParseNumber,
               "the time, in the dataset's unit: the nearest step is taken")
      .Group(group);
  if (has_sweep) {
    cli::AddFlag(set, "--step", "N|first|last|A:B[:STRIDE]", &flags->steps, ParseSteps,
                 "the time step, from 0 (default: last); A:B[:STRIDE] renders a frame for each "
                 "step that is served")
        .Group(group);
  } else {
    cli::AddFlag(set, "--step", "N|first|last", &flags->steps, ParseOneStep,
                 "the time step, from 0 (default: last)")
        .Group(group);
  }
}

absl::Status CheckUsage(const FieldFlags& flags) {
  return flags.time && flags.steps
             ? cli::UsageError("--time and --step both name a time step: give one of them")
             : absl::OkStatus();
}

absl::StatusOr<std::vector<int>> StepsOf(const StepRange& range,
                                         const isoscope::v1::Dataset& dataset) {
  const std::vector<int> served = ServedSteps(dataset);
  if (served.empty()) {
    return absl::InvalidArgumentError(absl::StrCat("--step: dataset \"", dataset.name(),
                                                   "\" has one step, without a number; leave "
                                                   "--step out"));
  }
  const int first = NumberOf(range.first, served);
  if (!range.last) {
    return std::vector<int>{first};  // the server says if it is not served
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
    return absl::InvalidArgumentError(
        absl::StrCat("--step names no step that is served: dataset \"", dataset.name(), "\" has ",
                     served.front(), " to ", served.back()));
  }
  return steps;
}

absl::StatusOr<std::optional<isoscope::v1::FieldSelection>> SelectionOf(
    const FieldFlags& flags, const isoscope::v1::Dataset& dataset, std::optional<int> step) {
  if (!flags.field && !flags.time && !flags.steps && !step) {
    return std::optional<isoscope::v1::FieldSelection>();
  }
  isoscope::v1::FieldSelection selection;
  if (flags.field) {
    selection.set_field(flags.field->field);
    selection.set_component(flags.field->component);
  }
  if (step) {
    selection.set_time_step(*step);
  } else if (flags.steps) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<int> steps, StepsOf(*flags.steps, dataset));
    selection.set_time_step(steps.front());
  } else if (flags.time) {
    selection.set_time(*flags.time);
  }
  return std::optional<isoscope::v1::FieldSelection>(selection);
}

isoscope::v1::Dataset DatasetOfField(isoscope::v1::Dataset dataset,
                                     const std::optional<FieldName>& field) {
  if (!field) {
    return dataset;
  }
  const isoscope::v1::Field* const found = FindField(dataset, field->field);
  if (found == nullptr || found->components().empty()) {
    return dataset;
  }
  const isoscope::v1::FieldComponent* component = &found->components(found->components_size() - 1);
  for (int i = 0; i < found->components_size(); ++i) {
    if (!field->component.empty() &&
        (found->components(i).name() == field->component || absl::StrCat(i) == field->component)) {
      component = &found->components(i);
      break;
    }
  }
  const isoscope::v1::FieldComponent chosen = *component;
  dataset.set_sample_type(chosen.sample_type());
  dataset.clear_value_range();
  if (chosen.has_value_range()) {
    *dataset.mutable_value_range() = chosen.value_range();
  }
  dataset.clear_max_gradient_magnitude();
  if (chosen.has_max_gradient_magnitude()) {
    dataset.set_max_gradient_magnitude(chosen.max_gradient_magnitude());
  }
  return dataset;
}

std::string TitleOfField(const isoscope::v1::Dataset& dataset, const FieldName& field) {
  const isoscope::v1::Field* const found = FindField(dataset, field.field);
  if (found == nullptr) {
    return "";
  }
  const std::string& name = found->long_name().empty() ? found->name() : found->long_name();
  return field.component.empty() ? name : absl::StrCat(name, " ", field.component);
}

std::string UnitOfField(const isoscope::v1::Dataset& dataset, const FieldName& field) {
  const isoscope::v1::Field* const found = FindField(dataset, field.field);
  return found == nullptr ? "" : found->unit();
}

}  // namespace isoscope::client
