#include "core/source/remote/aws_profile.h"

#include <cstdint>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/source/remote/core_files.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxAwsFileBytes = base::kMiB;

// "profile lab" and "lab" are "lab"; quotation marks around a name are no part of it.
std::string SectionName(absl::string_view text) {
  text = absl::StripAsciiWhitespace(text);
  if (absl::StartsWith(text, "profile ") || absl::StartsWith(text, "profile\t")) {
    text = absl::StripAsciiWhitespace(text.substr(8));
  }
  if (text.size() >= 2 && (text[0] == '"' || text[0] == '\'') && text.back() == text[0]) {
    text = text.substr(1, text.size() - 2);
  }
  return std::string(text);
}

absl::StatusOr<std::map<std::string, AwsSection>> ReadAwsFile(const std::string& path) {
  if (path.empty() || !io::PathExists(path)) {
    return std::map<std::string, AwsSection>{};
  }
  ForbidCores();  // both files may have keys
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string text, io::ReadWholeFile(path, kMaxAwsFileBytes));
  return ParseAwsFile(text, path);
}

}  // namespace

absl::StatusOr<std::map<std::string, AwsSection>> ParseAwsFile(absl::string_view text,
                                                               const std::string& path) {
  std::map<std::string, AwsSection> sections;
  AwsSection* section = nullptr;
  std::string parent;  // of nested values: the name of a line without a value
  std::int64_t line_number = 0;
  for (const absl::string_view line : absl::StrSplit(text, '\n')) {
    ++line_number;
    const absl::string_view words = absl::StripAsciiWhitespace(line);
    if (words.empty() || words[0] == '#' || words[0] == ';') {
      continue;
    }
    const auto fault = [&](absl::string_view what) {
      return absl::InvalidArgumentError(absl::StrCat(path, ": line ", line_number, " ", what));
    };
    if (words[0] == '[') {
      const std::size_t end = words.find(']');
      if (end == absl::string_view::npos) {
        return fault("begins a section whose ']' is missing");
      }
      section = &sections[SectionName(words.substr(1, end - 1))];
      parent.clear();
      continue;
    }
    const std::size_t equals = words.find('=');
    if (section == nullptr || equals == absl::string_view::npos) {
      return fault(section == nullptr ? "stands before the first section; expected [NAME]"
                                      : "has no '='; expected name = value");
    }
    const std::string name =
        absl::AsciiStrToLower(absl::StripAsciiWhitespace(words.substr(0, equals)));
    const absl::string_view value = absl::StripAsciiWhitespace(words.substr(equals + 1));
    const bool is_nested = absl::ascii_isspace(static_cast<unsigned char>(line[0]));
    if (is_nested && !parent.empty()) {
      (*section)[absl::StrCat(parent, ".", name)] = std::string(value);
      continue;
    }
    parent = value.empty() ? name : "";
    (*section)[name] = std::string(value);
  }
  return sections;
}

absl::StatusOr<AwsProfile> ReadAwsProfile(const std::string& config_path,
                                          const std::string& credentials_path,
                                          const std::string& profile) {
  ISOSCOPE_ASSIGN_OR_RETURN(auto config, ReadAwsFile(config_path));
  ISOSCOPE_ASSIGN_OR_RETURN(auto credentials, ReadAwsFile(credentials_path));
  AwsProfile found;
  for (auto* const sections : {&credentials, &config}) {
    const auto section = sections->find(profile);
    if (section != sections->end()) {
      found.is_found = true;
      found.values.merge(section->second);  // keeps what is there
    }
  }
  return found;
}

}  // namespace isoscope::source
