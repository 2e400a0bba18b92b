// Flags whose values have types, on top of FlagSet. Each takes the parser of its type,
// absl::string_view -> absl::StatusOr<T>. `value` and `values` must outlive the parsing.

#ifndef ISOSCOPE_CORE_CLI_FLAGS_H_
#define ISOSCOPE_CORE_CLI_FLAGS_H_

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/base/status_macros.h"
#include "core/cli/command.h"
#include "core/cli/flag_set.h"

namespace isoscope::cli {

template <typename T, typename Parser>
ValueParser StoreIn(std::optional<T>* value, Parser parse) {
  return [value, parse = std::move(parse)](absl::string_view text) -> absl::Status {
    ISOSCOPE_ASSIGN_OR_RETURN(*value, parse(text));
    return absl::OkStatus();
  };
}

template <typename T, typename Parser>
ValueParser AddTo(std::vector<T>* values, Parser parse) {
  return [values, parse = std::move(parse)](absl::string_view text) -> absl::Status {
    ISOSCOPE_ASSIGN_OR_RETURN(T value, parse(text));
    values->push_back(std::move(value));
    return absl::OkStatus();
  };
}

// Adds a flag, or a positional argument. `value` stays unset if the flag is not given.
template <typename T, typename Parser>
Flag AddFlag(FlagSet* set, const std::string& name, const std::string& value_name,
             std::optional<T>* value, Parser parse, const std::string& help) {
  return set->Add(name, value_name, StoreIn(value, std::move(parse)), help);
}

// Adds a flag whose value may be left out. `parse` then gets an empty text.
template <typename T, typename Parser>
Flag AddFlagWithDefault(FlagSet* set, const std::string& name, const std::string& value_name,
                        std::optional<T>* value, Parser parse, const std::string& help) {
  return set->AddOptional(name, value_name, StoreIn(value, std::move(parse)), help);
}

// Adds a flag that takes one or more values, apart by spaces or commas. `values` stays empty if
// the flag is not given.
template <typename T, typename Parser>
Flag AddListFlag(FlagSet* set, const std::string& name, const std::string& value_name,
                 std::vector<T>* values, Parser parse, const std::string& help) {
  return set->AddList(name, value_name, AddTo(values, std::move(parse)), help);
}

// Adds a flag that may be given several times, with one value each. `values` stays empty if the
// flag is not given.
template <typename T, typename Parser>
Flag AddRepeatableFlag(FlagSet* set, const std::string& name, const std::string& value_name,
                       std::vector<T>* values, Parser parse, const std::string& help) {
  return set->AddRepeatable(name, value_name, AddTo(values, std::move(parse)), help);
}

// Any text but the empty one.
absl::StatusOr<std::string> ParseText(absl::string_view text);

// Registers --quiet.
void AddQuietFlag(FlagSet* set, bool* is_quiet);
// The surroundings of a command that was told to be quiet: no text goes to standard output, and no
// progress to standard error. Warnings and errors stay.
Context QuietContext(const Context& context);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CORE_CLI_FLAGS_H_
