#include "wire/field_selection.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "core/base/error_reason.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/store/series_manifest.h"
#include "core/volume/field_name.h"

namespace isoscope::wire {
namespace {

namespace v1 = isoscope::v1;

// A message names this many steps, and then says "...".
constexpr std::size_t kMaxNamedSteps = 16;

template <typename Named>
std::string JoinNames(const google::protobuf::RepeatedPtrField<Named>& named) {
  return absl::StrJoin(named, ", ", [](std::string* out, const Named& one) {
    absl::StrAppend(out, "\"", one.name(), "\"");
  });
}

// Returns the nearest of `steps`, which ascend with their times; of two the earlier. Compares two
// neighbours alone: distances from far away would round to one number.
int NearestStep(const v1::Dataset& dataset, const std::vector<int>& steps, double time) {
  const auto next = std::find_if(steps.begin(), steps.end(), [&](int step) {
    return TimeOf(dataset, step).value_or(0) >= time;
  });
  if (next == steps.begin()) {
    return *next;
  }
  const int before = *(next - 1);
  if (next == steps.end()) {
    return before;
  }
  const double to_next = TimeOf(dataset, *next).value_or(0) - time;
  return time - TimeOf(dataset, before).value_or(0) <= to_next ? before : *next;
}

std::optional<volume::FieldName> FindName(const v1::Dataset& dataset, const std::string& text) {
  return volume::FindFieldName(text, [&](absl::string_view name) -> std::optional<std::size_t> {
    const auto found = std::find_if(dataset.fields().begin(), dataset.fields().end(),
                                    [&](const v1::Field& of) { return of.name() == name; });
    return found == dataset.fields().end() ? std::nullopt
                                           : std::optional<std::size_t>(static_cast<std::size_t>(
                                                 found - dataset.fields().begin()));
  });
}

}  // namespace

absl::StatusOr<FieldPlace> FindField(const v1::Dataset& dataset, const std::string& field,
                                     const std::string& asked_component, absl::string_view path) {
  FieldPlace place;
  std::string component = asked_component;
  if (!field.empty()) {
    auto found = FindName(dataset, field);
    // Programs that split at the last colon know no names with colons.
    if (!found.has_value() && !component.empty()) {
      found = FindName(dataset, absl::StrCat(field, ":", component));
      component.clear();
    }
    if (!found.has_value() || (!found->component.empty() && !component.empty())) {
      return absl::InvalidArgumentError(absl::StrCat(path, "field is ", base::Quoted(field),
                                                     ": dataset \"", dataset.name(), "\" has ",
                                                     JoinNames(dataset.fields())));
    }
    place.field = static_cast<int>(found->field);
    component = found->component.empty() ? component : found->component;
  }
  const v1::Field& chosen = dataset.fields(place.field);
  if (chosen.components().empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, "field is \"", chosen.name(), "\": it has no components"));
  }
  place.component = chosen.components_size() - 1;  // the only one, or the magnitude
  if (component.empty()) {
    return place;
  }
  // A number names a component, too.
  for (int i = 0; i < chosen.components_size(); ++i) {
    const std::string& name = chosen.components(i).name();
    const bool is_own = name != store::kMagnitudeName;
    if (name == component ||
        (is_own && chosen.components_size() > 1 && component == absl::StrCat(i))) {
      place.component = i;
      return place;
    }
  }
  return absl::InvalidArgumentError(absl::StrCat(
      path, "component is ", base::Quoted(component), ": field \"", chosen.name(), "\" has ",
      chosen.components_size() == 1 ? "one component, without a name"
                                    : JoinNames(chosen.components())));
}

std::vector<int> StepsOf(const v1::Dataset& dataset, int field) {
  std::vector<int> steps;
  for (const int index : dataset.fields(field).time_steps()) {
    if (index >= 0 && index < dataset.time_steps_size()) {
      steps.push_back(dataset.time_steps(index).number());
    }
  }
  return steps;
}

std::string DescribeSteps(const std::vector<int>& steps) {
  if (steps.empty()) {
    return "none";
  }
  if (static_cast<std::size_t>(steps.back() - steps.front()) + 1 == steps.size()) {
    return steps.size() == 1 ? absl::StrCat(steps.front())
                             : absl::StrCat(steps.front(), " to ", steps.back());
  }
  const std::size_t named = std::min(steps.size(), kMaxNamedSteps);
  return absl::StrCat(
      absl::StrJoin(steps.begin(), steps.begin() + static_cast<std::ptrdiff_t>(named), ", "),
      named < steps.size() ? absl::StrCat(", ... (", steps.size(), " in all)") : "");
}

std::optional<double> TimeOf(const v1::Dataset& dataset, int step) {
  for (const v1::TimeStep& time : dataset.time_steps()) {
    if (time.number() == step) {
      return time.value();
    }
  }
  return std::nullopt;
}

absl::StatusOr<int> ChooseStep(const v1::Dataset& dataset, const v1::FieldSelection& selection,
                               const std::vector<int>& steps) {
  if (steps.empty()) {
    return base::WithReason(
        absl::FailedPreconditionError(absl::StrCat(
            "dataset \"", dataset.name(), "\": no step of the field is served by all shards yet")),
        base::ErrorReason::kDatasetIncomplete);
  }
  switch (selection.when_case()) {
    case v1::FieldSelection::kTimeStep: {
      const int step = selection.time_step();
      if (step == -1) {
        return steps.back();
      }
      if (!std::binary_search(steps.begin(), steps.end(), step)) {
        return absl::NotFoundError(absl::StrCat("selection.time_step is ", step, ": dataset \"",
                                                dataset.name(), "\" serves steps ",
                                                DescribeSteps(steps), " of the field"));
      }
      return step;
    }
    case v1::FieldSelection::kTime: {
      if (!std::isfinite(selection.time())) {
        return absl::InvalidArgumentError(
            absl::StrCat("selection.time is ", selection.time(), ": must be finite"));
      }
      if (!TimeOf(dataset, steps.front()).has_value()) {
        return absl::InvalidArgumentError(absl::StrCat("selection.time is ", selection.time(),
                                                       ": dataset \"", dataset.name(),
                                                       "\" has no times"));
      }
      return NearestStep(dataset, steps, selection.time());
    }
    case v1::FieldSelection::WHEN_NOT_SET:
      return steps.back();
  }
  return steps.back();
}

absl::StatusOr<v1::FieldSelection> ResolveSelection(const v1::FieldSelection& selection,
                                                    const v1::Dataset& dataset) {
  ISOSCOPE_ASSIGN_OR_RETURN(const FieldPlace place, FindField(dataset, selection.field(),
                                                              selection.component(), "selection."));
  v1::FieldSelection resolved = selection;
  resolved.set_field(dataset.fields(place.field).name());
  resolved.set_component(dataset.fields(place.field).components(place.component).name());
  if (!dataset.time_steps().empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(const int step,
                              ChooseStep(dataset, selection, StepsOf(dataset, place.field)));
    resolved.set_time_step(step);
  }
  return resolved;
}

}  // namespace isoscope::wire
