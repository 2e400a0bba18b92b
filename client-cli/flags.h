// Flags with our own parsers and messages, on top of CLI11.

#ifndef ISOSCOPE_CLIENT_CLI_FLAGS_H_
#define ISOSCOPE_CLIENT_CLI_FLAGS_H_

#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include <CLI/CLI.hpp>

namespace isoscope::cli {

// Adds a flag (or, without dashes, a positional argument) whose text `parse` turns into
// absl::StatusOr<T>; an error of it is wrong usage. `value` stays unset if the flag is not given;
// it must outlive the parsing.
template <typename T, typename Parser>
CLI::Option* AddFlag(CLI::App* app, const std::string& name, const std::string& type_name,
                     std::optional<T>* value, Parser parse, const std::string& help) {
  CLI::Option* option = app->add_option_function<std::string>(
      name, [value, parse](const std::string& text) { *value = *parse(text); }, help);
  option->check([parse](const std::string& text) {
    const absl::StatusOr<T> parsed = parse(text);
    return absl::StrCat(parsed.status().message());
  });
  return option->type_name(type_name);
}

// Adds a flag whose value may be left out: last, before another flag, or with "=true". `parse` then
// gets no text.
template <typename T, typename Parser>
CLI::Option* AddFlagWithDefault(CLI::App* app, const std::string& name,
                                const std::string& type_name, std::optional<T>* value, Parser parse,
                                const std::string& help) {
  const auto parse_given = [parse](absl::string_view text) {
    return parse(text == "true" ? absl::string_view() : text);  // CLI11 gives it for no value
  };
  return AddFlag(app, name, type_name, value, parse_given, help)->expected(0, 1);
}

// The part that the two flags with several values have in common.
template <typename T, typename Parser>
CLI::Option* AddValuesFlag(CLI::App* app, const std::string& name, const std::string& type_name,
                           std::vector<T>* values, Parser parse, const std::string& help) {
  CLI::Option* option = app->add_option_function<std::vector<std::string>>(
      name,
      [values, parse](const std::vector<std::string>& texts) {
        for (const std::string& text : texts) {
          values->push_back(*parse(text));
        }
      },
      help);
  option->check([parse](const std::string& text) {
    const absl::StatusOr<T> parsed = parse(text);
    return absl::StrCat(parsed.status().message());
  });
  return option->type_name(type_name);
}

// Adds a flag that takes one or more values, apart by spaces or commas: "--shards 1 4" is
// "--shards 1,4". `values` stays empty if the flag is not given; it must outlive the parsing.
template <typename T, typename Parser>
CLI::Option* AddListFlag(CLI::App* app, const std::string& name, const std::string& type_name,
                         std::vector<T>* values, Parser parse, const std::string& help) {
  return AddValuesFlag(app, name, type_name, values, parse, help)->delimiter(',');
}

// Adds a flag that may be given several times, with one value each. `values` stays empty if it is
// not given; it must outlive the parsing.
template <typename T, typename Parser>
CLI::Option* AddRepeatableFlag(CLI::App* app, const std::string& name, const std::string& type_name,
                               std::vector<T>* values, Parser parse, const std::string& help) {
  return AddValuesFlag(app, name, type_name, values, parse, help)->allow_extra_args(false);
}

// Any text that is not empty.
inline absl::StatusOr<std::string> ParseText(absl::string_view text) {
  if (text.empty()) {
    return absl::InvalidArgumentError("is empty");
  }
  return absl::StrCat(text);
}

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_FLAGS_H_
