#include "core/formats/medical/jcamp_parameters.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"

#include "core/base/status_macros.h"
#include "core/source/bytes/text_header.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kMaxJcampNumbers = 9'000'000;  // nine for each of a million frames
constexpr std::size_t kQuoted = 20;                  // characters of a file in a message

}  // namespace

void JcampParameters::Set(absl::string_view name, absl::string_view text) {
  parameters_[std::string(name)] = std::string(text);
}

absl::string_view JcampParameters::Text(const std::string& name) const {
  const auto found = parameters_.find(name);
  absl::string_view text = found == parameters_.end() ? absl::string_view() : found->second;
  if (const std::size_t end = text.find(')'); absl::StartsWith(text, "( ") && end != text.npos) {
    text.remove_prefix(end + 1);
  }
  return absl::StripAsciiWhitespace(text);
}

absl::StatusOr<std::int64_t> JcampParameters::Count(const std::string& name,
                                                    std::int64_t most) const {
  std::int64_t count = 0;
  if (!absl::SimpleAtoi(Text(name), &count) || count < 1 || count > most) {
    return Error(absl::StrFormat("%s is \"%s\"; expected 1 to %d", name,
                                 Text(name).substr(0, kQuoted), most));
  }
  return count;
}

absl::StatusOr<std::vector<double>> JcampParameters::Numbers(const std::string& name) const {
  std::vector<double> numbers;
  absl::string_view text = Text(name);
  while (!text.empty()) {
    std::size_t repeats = 1;
    absl::string_view run = text.substr(0, text.find('@'));
    if (run.empty()) {  // "@4*(0 1) 2 3"
      const std::size_t begin = text.find("*(");
      const std::size_t end = text.find(')');
      if (begin == text.npos || end == text.npos || end < begin ||
          !absl::SimpleAtoi(text.substr(1, begin - 1), &repeats)) {
        return Error(absl::StrFormat("%s has \"%s\"; expected @COUNT*(NUMBERS)", name,
                                     text.substr(0, kQuoted)));
      }
      run = text.substr(begin + 2, end - begin - 2);
      text.remove_prefix(end + 1);
    } else {
      text.remove_prefix(run.size());
    }
    text = absl::StripLeadingAsciiWhitespace(text);
    std::vector<double> read;
    for (const absl::string_view word :
         absl::StrSplit(run, absl::ByAnyChar(" \t\n"), absl::SkipEmpty())) {
      if (!absl::SimpleAtod(word, &read.emplace_back()) || !std::isfinite(read.back())) {
        return Error(
            absl::StrFormat("%s has \"%s\"; expected numbers", name, word.substr(0, kQuoted)));
      }
    }
    if (repeats > kMaxJcampNumbers || read.size() * repeats > kMaxJcampNumbers - numbers.size()) {
      return Error(absl::StrFormat("%s has more than %d numbers", name, kMaxJcampNumbers));
    }
    for (; repeats > 0; --repeats) {
      numbers.insert(numbers.end(), read.begin(), read.end());
    }
  }
  return numbers;
}

absl::StatusOr<std::vector<double>> JcampParameters::Numbers(
    const std::string& name, const std::set<std::size_t>& counts) const {
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<double> numbers, Numbers(name));
  if (!counts.contains(numbers.size())) {
    return Error(absl::StrFormat("%s has %d numbers; expected %s", name, numbers.size(),
                                 absl::StrJoin(counts, " or ")));
  }
  return numbers;
}

absl::Status JcampParameters::Error(absl::string_view text) const {
  return absl::InvalidArgumentError(absl::StrCat(path_, ": ParaVision parameters: ", text));
}

absl::StatusOr<JcampParameters> ReadJcampParameters(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string text, ReadTextHeader(path));
  JcampParameters parameters(path);
  std::string name;
  std::string value;
  std::size_t at = 0;
  absl::string_view line;
  bool has_end = false;
  while (!has_end && NextLine(text, &at, &line)) {
    if (absl::StartsWith(line, "$$")) {
      continue;  // a comment, also between lines of numbers
    }
    if (!absl::StartsWith(line, "##")) {
      absl::StrAppend(&value, " ", line);
      continue;
    }
    if (!name.empty()) {
      parameters.Set(name, value);
    }
    has_end = absl::StartsWith(line, "##END");
    const std::size_t equals = std::min(line.find('='), line.size() - 1);
    name = absl::StartsWith(line, "##$") ? std::string(line.substr(3, equals - 3)) : "";
    value = std::string(line.substr(equals + 1));
  }
  if (!has_end) {
    return parameters.Error("no ##END: the file is cut, or is not one of ParaVision");
  }
  return parameters;
}

}  // namespace isoscope::source
