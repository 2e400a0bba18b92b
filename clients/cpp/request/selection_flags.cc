#include "clients/cpp/request/selection_flags.h"

#include <cstddef>
#include <limits>

#include "absl/strings/str_cat.h"

#include "clients/cpp/request/parse_value.h"
#include "core/base/printable.h"
#include "core/cli/flags.h"
#include "core/cli/usage.h"

namespace isoscope::client {

absl::StatusOr<FieldValue> ParseField(absl::string_view text) {
  if (text.empty() || text.front() == ':' || text.back() == ':') {
    return absl::InvalidArgumentError(absl::StrCat(
        base::Quoted(text, '\''), " is not NAME or NAME:COMPONENT, such as velocity:x"));
  }
  return FieldValue{.name = std::string(text)};
}

absl::StatusOr<std::int64_t> ParseStep(absl::string_view text) {
  if (text == "first") {
    return 0;
  }
  if (text == "last") {
    return -1;
  }
  const absl::StatusOr<std::int64_t> step =
      ParseInteger(text, 0, std::numeric_limits<std::int32_t>::max());
  if (!step.ok()) {
    return absl::InvalidArgumentError(absl::StrCat(
        base::Quoted(text, '\''), " is not the number of a time step, from 0, or first or last"));
  }
  return *step;
}

void AddSelectionFlags(cli::FlagSet* set, SelectionFlags* flags) {
  const std::string group = "Field and time";
  cli::AddFlag(set, "--field", "NAME[:COMPONENT]", &flags->field, ParseField,
               "the field whose surfaces are drawn, and its component: x, y, z, a number or "
               "magnitude (default: the first field; of several components, the magnitude)")
      .Group(group);
  cli::AddFlag(set, "--component", "NAME", &flags->component, cli::ParseText,
               "the component, apart from the field's name")
      .Group(group);
  cli::AddFlag(set, "--time", "T", &flags->time, ParseNumber,
               "the time, in the dataset's unit: the step nearest to it is drawn")
      .Group(group);
  cli::AddFlag(set, "--step", "N|first|last", &flags->step, ParseStep,
               "the time step, by its number from 0 (default: the last)")
      .Group(group);
}

absl::Status CheckUsage(const SelectionFlags& flags) {
  if (flags.time && flags.step) {
    return cli::UsageError("--time and --step exclude each other: both name a time step");
  }
  if (flags.component && flags.field && !flags.field->component.empty()) {
    return cli::UsageError(absl::StrCat("--component is ", *flags.component, ", but --field ",
                                        flags.field->name, ":", flags.field->component,
                                        " has a component already: leave one out"));
  }
  return absl::OkStatus();
}

std::optional<isoscope::v1::FieldSelection> ToProto(const SelectionFlags& flags) {
  if (flags.empty()) {
    return std::nullopt;
  }
  isoscope::v1::FieldSelection proto;
  if (flags.field) {
    proto.set_field(flags.field->name);
    proto.set_component(flags.field->component);
  }
  if (flags.component) {
    proto.set_component(*flags.component);
  }
  if (flags.time) {
    proto.set_time(*flags.time);
  } else if (flags.step) {
    proto.set_time_step(static_cast<std::int32_t>(*flags.step));
  }
  return proto;
}

}  // namespace isoscope::client
