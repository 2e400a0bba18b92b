#include "core/cli/command_description.h"

#include <algorithm>
#include <cstddef>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_split.h"

namespace isoscope::cli {
namespace {

// Whether `text` has only small letters, digits, and characters that join them: "marschner-lobb",
// "16".
bool IsWord(absl::string_view text) {
  return !text.empty() && text[0] != '-' && std::all_of(text.begin(), text.end(), [](char c) {
    const auto byte = static_cast<unsigned char>(c);
    return absl::ascii_islower(byte) || absl::ascii_isdigit(byte) || c == '-' || c == '.';
  });
}

}  // namespace

std::vector<std::string> ChoicesOf(absl::string_view value_name) {
  // "TEXT:{auto,egl,cpu}": CLI11 writes a list that it checks in this form.
  const std::size_t list = value_name.find('{');
  if (list != absl::string_view::npos) {
    const std::size_t end = std::min(value_name.find('}'), value_name.size());
    return absl::StrSplit(value_name.substr(list + 1, end - list - 1), ',');
  }
  // "x|y|z|gradient[:MAP]": the part in brackets belongs to the last word.
  std::vector<std::string> words =
      absl::StrSplit(value_name.substr(0, value_name.find('[')), '|', absl::SkipEmpty());
  words.erase(std::remove_if(words.begin(), words.end(),
                             [](const std::string& word) { return !IsWord(word); }),
              words.end());
  return absl::StrContains(value_name, "|") ? words : std::vector<std::string>();
}

void SetValueName(const std::string& value_name, FlagDescription* flag) {
  flag->value_name = value_name;
  flag->choices = ChoicesOf(value_name);
  flag->takes_files = absl::StrContains(value_name, "FILE") ||
                      absl::StrContains(value_name, "INPUT") ||
                      absl::StrContains(value_name, "SCRIPT");
  flag->takes_folders = absl::StrContains(value_name, "DIR");
}

}  // namespace isoscope::cli
