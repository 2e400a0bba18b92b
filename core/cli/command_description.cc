#include "core/cli/command_description.h"

#include <algorithm>
#include <cstddef>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include <CLI/CLI.hpp>

namespace isoscope::cli {
namespace {

// Small letters, digits and what joins them: "marschner-lobb", "16".
bool IsWord(absl::string_view text) {
  return !text.empty() && text[0] != '-' && std::all_of(text.begin(), text.end(), [](char c) {
    const auto byte = static_cast<unsigned char>(c);
    return absl::ascii_islower(byte) || absl::ascii_isdigit(byte) || c == '-' || c == '.';
  });
}

FlagDescription Describe(const CLI::Option& option) {
  FlagDescription flag;
  for (const std::string& name : option.get_lnames()) {
    flag.names.push_back(absl::StrCat("--", name));
  }
  for (const std::string& name : option.get_snames()) {
    flag.names.push_back(absl::StrCat("-", name));
  }
  flag.help = option.get_description();
  flag.group = option.get_group();
  flag.environment = option.get_envname();
  flag.default_value = option.get_default_str();
  flag.is_repeatable = option.get_items_expected_max() > 1;
  if (option.get_type_size_max() == 0) {
    return flag;  // a switch
  }
  flag.has_optional_value = option.get_expected_min() == 0;
  flag.value_name = option.get_type_name();
  flag.choices = ChoicesOf(flag.value_name);
  flag.takes_files = absl::StrContains(flag.value_name, "FILE") ||
                     absl::StrContains(flag.value_name, "INPUT") ||
                     absl::StrContains(flag.value_name, "SCRIPT");
  flag.takes_folders = absl::StrContains(flag.value_name, "DIR");
  return flag;
}

}  // namespace

std::vector<std::string> ChoicesOf(absl::string_view value_name) {
  // "TEXT:{auto,egl,cpu}": a list that CLI11 checks, and says so.
  const std::size_t list = value_name.find('{');
  if (list != absl::string_view::npos) {
    const std::size_t end = std::min(value_name.find('}'), value_name.size());
    return absl::StrSplit(value_name.substr(list + 1, end - list - 1), ',');
  }
  // "x|y|z|gradient[:MAP]": what follows belongs to the last word.
  std::vector<std::string> words =
      absl::StrSplit(value_name.substr(0, value_name.find('[')), '|', absl::SkipEmpty());
  words.erase(std::remove_if(words.begin(), words.end(),
                             [](const std::string& word) { return !IsWord(word); }),
              words.end());
  return absl::StrContains(value_name, "|") ? words : std::vector<std::string>();
}

std::vector<FlagDescription> DescribeFlags(const CLI::App& app) {
  std::vector<FlagDescription> flags;
  for (const CLI::Option* const option : app.get_options()) {
    if (!option->get_group().empty()) {
      flags.push_back(Describe(*option));
    }
  }
  return flags;
}

}  // namespace isoscope::cli
