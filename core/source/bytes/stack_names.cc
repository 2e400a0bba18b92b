// A name is split into text and numbers: "d/s2_z007.tif" is the text "d/s#_z#.tif" with 2 and 7.
// The check has these steps:
//
//   1. Files of different texts are different stacks.
//   2. Numbers that are the same in all files say nothing. A number that varies, but is the same in
//      neighbours or goes down, tells several stacks apart: s1_z1, s1_z2, s2_z1, s2_z2.
//   3. One of the numbers that are left must go up in even steps. Decimals (z0.5, z1.0) look like
//      several stacks, but may be one.

#include "core/source/bytes/stack_names.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <set>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"

#include "core/source/bytes/named_files.h"

namespace isoscope::source {
namespace {

constexpr char kAsNeighbours[] =
    "--axes Z (of render: --input-axes Z) takes the files as neighbours, in the order of their "
    "names";

struct SplitName {
  std::string text;                   // "#" for each number
  std::vector<std::int64_t> numbers;  // the greatest one for more digits than it has
  std::vector<std::string> digits{};  // as they are written
};

SplitName Split(const std::string& name) {
  SplitName split;
  const auto is_digit = [](char c) { return absl::ascii_isdigit(static_cast<unsigned char>(c)); };
  const std::size_t ending = name.rfind('.');  // in any case
  for (std::size_t i = 0; i < name.size();) {
    std::size_t end = i;
    while (end < name.size() && is_digit(name[end])) {
      ++end;
    }
    if (end == i) {
      split.text += i > ending ? absl::ascii_tolower(static_cast<unsigned char>(name[i])) : name[i];
      ++i;
      continue;
    }
    split.text += '#';
    split.digits.push_back(name.substr(i, end - i));
    std::int64_t number = 0;
    split.numbers.push_back(absl::SimpleAtoi(split.digits.back(), &number)
                                ? number
                                : std::numeric_limits<std::int64_t>::max());
    i = end;
  }
  split.text = absl::StrReplaceAll(split.text, {{".tiff", ".tif"}, {".jpeg", ".jpg"}});
  return split;
}

// The name with another number at one place, and with as many digits at least.
std::string WithNumber(const std::string& name, std::size_t place, std::int64_t number) {
  const auto is_digit = [](char c) { return absl::ascii_isdigit(static_cast<unsigned char>(c)); };
  auto end = name.begin();
  auto begin = end;
  for (std::size_t i = 0; i <= place; ++i) {
    begin = std::find_if(end, name.end(), is_digit);
    end = std::find_if_not(begin, name.end(), is_digit);
  }
  return absl::StrFormat("%s%0*d%s", std::string(name.begin(), begin),
                         static_cast<int>(end - begin), number, std::string(end, name.end()));
}

std::string BaseName(const std::string& path) { return path.substr(path.rfind('/') + 1); }

// A pattern of the names of a stack: those numbers that are the same in all stay.
std::string PatternOf(const std::vector<SplitName>& names) {
  std::string pattern;
  std::size_t number = 0;
  for (const char c : names.front().text) {
    if (c != '#') {
      pattern += c;
      continue;
    }
    const std::string& digits = names.front().digits[number];
    const bool is_same = std::all_of(names.begin(), names.end(), [&](const SplitName& name) {
      return name.digits[number] == digits;
    });
    pattern += is_same ? digits : "[0-9]*";
    ++number;
  }
  return pattern;
}

// "a[0-9]*.tif (40 files)" of each, four at most; and a pattern that gives one of them alone.
absl::Status SeveralStacks(const std::string& path,
                           const std::vector<std::vector<std::string>>& stacks) {
  std::vector<std::string> texts;
  std::string example;
  for (const std::vector<std::string>& files : stacks) {
    std::vector<SplitName> names;
    names.reserve(files.size());
    for (const std::string& file : files) {
      names.push_back(Split(file));
    }
    const std::string pattern = PatternOf(names);
    if (texts.size() < 3) {
      texts.push_back(files.size() == 1
                          ? BaseName(files.front())
                          : absl::StrFormat("%s (%d files)", BaseName(pattern), files.size()));
    }
    const auto is_there = [](const std::string&) { return true; };
    if (example.empty() && files.size() > 1 && FilesNamed(pattern, is_there) == files) {
      example = pattern;
    }
  }
  if (stacks.size() > texts.size()) {
    texts.push_back(absl::StrCat(stacks.size() - texts.size(), " more"));
  }
  return absl::InvalidArgumentError(
      absl::StrCat(path, ": files of several stacks: ", absl::StrJoin(texts, ", "), "; choose one",
                   example.empty() ? " by a pattern" : absl::StrCat(", as in '", example, "'"),
                   "; or ", kAsNeighbours));
}

// No number tells the order of any two files.
absl::Status NoNumbers(const std::string& path, const std::vector<std::string>& files) {
  constexpr std::size_t kMaxNamed = 3;
  std::vector<std::string> texts;
  for (std::size_t i = 0; i < std::min(files.size(), kMaxNamed); ++i) {
    texts.push_back(BaseName(files[i]));
  }
  if (files.size() > kMaxNamed) {
    texts.push_back(absl::StrCat(files.size() - kMaxNamed, " more"));
  }
  const std::string ending = files.front().substr(files.front().rfind('.'));
  return absl::InvalidArgumentError(absl::StrCat(
      path, ": no number says in which order the files lie: ", absl::StrJoin(texts, ", "),
      "; number them, as in z1", ending, ", z2", ending, ", ...; or ", kAsNeighbours));
}

// "5, 9 to 12".
std::string MissingNumbers(const std::vector<std::int64_t>& numbers, std::int64_t step) {
  constexpr std::size_t kMaxListed = 5;
  std::vector<std::string> texts;
  std::size_t gaps = 0;
  for (std::size_t i = 1; i < numbers.size(); ++i) {
    const std::int64_t first = numbers[i - 1] + step;
    const std::int64_t last = numbers[i] - step;
    if (first > last) {
      continue;
    }
    if (++gaps <= kMaxListed) {
      texts.push_back(first == last ? absl::StrCat(first) : absl::StrCat(first, " to ", last));
    }
  }
  return absl::StrCat(absl::StrJoin(texts, ", "), gaps > kMaxListed ? ", ..." : "");
}

// The numbers at one place of all names, which ascend.
absl::Status CheckSteps(const std::string& path, const std::vector<std::string>& files,
                        const std::vector<std::int64_t>& numbers) {
  std::int64_t step = std::numeric_limits<std::int64_t>::max();
  for (std::size_t i = 1; i < numbers.size(); ++i) {
    step = std::min(step, numbers[i] - numbers[i - 1]);
  }
  std::optional<std::size_t> uneven;
  bool is_gap = true;
  for (std::size_t i = 1; i < numbers.size(); ++i) {
    const std::int64_t distance = numbers[i] - numbers[i - 1];
    if (distance != step && !uneven.has_value()) {
      uneven = i;
    }
    is_gap = is_gap && distance % step == 0;
  }
  if (!uneven.has_value()) {
    return absl::OkStatus();
  }
  const std::string where =
      absl::StrCat(BaseName(files[*uneven - 1]), " and ", BaseName(files[*uneven]));
  return absl::InvalidArgumentError(absl::StrCat(
      path, ": ",
      is_gap
          ? absl::StrCat("slices are missing between ", where, ": ", MissingNumbers(numbers, step))
          : absl::StrFormat("the numbers of %s are %d apart, those of others %d", where,
                            numbers[*uneven] - numbers[*uneven - 1], step),
      "; ", kAsNeighbours));
}

absl::Status SameNumber(const std::string& path, const std::string& a, const std::string& b) {
  return absl::InvalidArgumentError(absl::StrCat(
      path, ": ", BaseName(a), " and ", BaseName(b),
      " have the same number: remove one, or choose the others by a pattern; ", kAsNeighbours));
}

// Groups files by the numbers at one place.
std::vector<std::vector<std::string>> StacksByNumber(const std::vector<std::string>& files,
                                                     const std::vector<SplitName>& names,
                                                     std::size_t place) {
  std::map<std::int64_t, std::vector<std::string>> groups;
  for (std::size_t i = 0; i < files.size(); ++i) {
    groups[names[i].numbers[place]].push_back(files[i]);
  }
  std::vector<std::vector<std::string>> stacks;
  stacks.reserve(groups.size());
  for (auto& [number, group] : groups) {
    stacks.push_back(std::move(group));
  }
  return stacks;
}

std::vector<std::int64_t> NumbersAt(const std::vector<SplitName>& names, std::size_t place) {
  std::vector<std::int64_t> numbers;
  numbers.reserve(names.size());
  for (const SplitName& name : names) {
    numbers.push_back(name.numbers[place]);
  }
  return numbers;
}

// The place of the number that tells stacks apart: of those that vary the one with the fewest
// values, the last of these. REQUIRES: a number varies.
std::size_t PlaceOfStacks(const std::vector<SplitName>& names) {
  std::size_t best = 0;
  std::size_t fewest = names.size() + 1;
  for (std::size_t place = 0; place < names.front().numbers.size(); ++place) {
    const std::vector<std::int64_t> numbers = NumbersAt(names, place);
    const std::size_t count = std::set<std::int64_t>(numbers.begin(), numbers.end()).size();
    if (count > 1 && count <= fewest) {
      fewest = count;
      best = place;
    }
  }
  return best;
}

// Returns true if numbers of the names read as decimals that ascend: z0.5, z1.0, z1.5. They may
// also be the numbers of two things, of channel 1 and slice 5.
bool AreDecimals(const std::vector<SplitName>& names) {
  std::size_t place = 0;
  const std::string& text = names.front().text;
  for (std::size_t i = 0; i + 2 < text.size(); ++i) {
    if (text[i] != '#') {
      continue;
    }
    if (text[i + 1] == '.' && text[i + 2] == '#') {
      std::vector<double> values;
      std::set<std::int64_t> parts;  // behind the point
      for (const SplitName& name : names) {
        double value = 0;
        if (absl::SimpleAtod(absl::StrCat(name.digits[place], ".", name.digits[place + 1]),
                             &value)) {
          values.push_back(value);
        }
        parts.insert(name.numbers[place + 1]);
      }
      if (values.size() == names.size() && parts.size() > 1 &&
          std::adjacent_find(values.begin(), values.end(), std::greater_equal<>()) ==
              values.end()) {
        return true;
      }
    }
    ++place;
  }
  return false;
}

// A pattern would choose some of the heights of one stack.
absl::Status Decimals(const std::string& path, const std::vector<std::string>& files) {
  return absl::InvalidArgumentError(absl::StrCat(path, ": the numbers of ", BaseName(files.front()),
                                                 " to ", BaseName(files.back()),
                                                 " read as decimals, heights of one stack, or as "
                                                 "those of several stacks; if they are heights, ",
                                                 kAsNeighbours));
}

// Checks the numbers of names with one text.
absl::Status CheckNumbers(const std::string& path, const std::vector<std::string>& files,
                          const std::vector<SplitName>& names) {
  for (std::size_t i = 1; i < names.size(); ++i) {
    if (names[i].numbers == names[i - 1].numbers) {
      return SameNumber(path, files[i - 1], files[i]);
    }
  }
  absl::Status status;
  for (std::size_t place = names.front().numbers.size(); place-- > 0;) {
    const std::vector<std::int64_t> numbers = NumbersAt(names, place);
    if (std::adjacent_find(numbers.begin(), numbers.end(), std::greater_equal<>()) !=
        numbers.end()) {
      continue;
    }
    // One number that is even will do; else the last one of the names tells what is wrong.
    absl::Status steps = CheckSteps(path, files, numbers);
    if (steps.ok()) {
      return steps;
    }
    status = status.ok() ? steps : status;
  }
  if (status.ok() && AreDecimals(names)) {
    return Decimals(path, files);
  }
  return status.ok() ? SeveralStacks(path, StacksByNumber(files, names, PlaceOfStacks(names)))
                     : status;
}

}  // namespace

absl::Status CheckStackNames(const std::string& path, const std::vector<std::string>& files) {
  std::map<std::string, std::vector<std::string>> by_text;
  std::vector<SplitName> names;
  for (const std::string& file : files) {
    names.push_back(Split(file));
    by_text[names.back().text].push_back(file);
  }
  if (by_text.size() == files.size() && files.size() > 1) {
    return NoNumbers(path, files);
  }
  if (by_text.size() > 1) {
    std::vector<std::vector<std::string>> stacks;
    stacks.reserve(by_text.size());
    for (auto& [text, group] : by_text) {
      stacks.push_back(std::move(group));
    }
    std::stable_sort(stacks.begin(), stacks.end(),
                     [](const auto& a, const auto& b) { return a.size() > b.size(); });
    return SeveralStacks(path, stacks);
  }
  return CheckNumbers(path, files, names);
}

std::vector<std::string> NamesMissingBetween(const std::vector<std::string>& files,
                                             std::size_t least_count) {
  constexpr std::size_t kMaxNamed = 5;
  std::vector<SplitName> names;
  names.reserve(files.size());
  for (const std::string& file : files) {
    names.push_back(Split(file));
  }
  const bool are_alike =
      files.size() > 1 && std::all_of(names.begin(), names.end(), [&](const SplitName& name) {
        return name.text == names.front().text;
      });
  // The only number that varies.
  std::optional<std::size_t> place;
  for (std::size_t i = 0; are_alike && i < names.front().numbers.size(); ++i) {
    const bool varies = std::any_of(names.begin(), names.end(), [&](const SplitName& name) {
      return name.digits[i] != names.front().digits[i];
    });
    if (varies && place.has_value()) {
      return {};
    }
    place = varies ? i : place;
  }
  if (!place.has_value()) {
    return {};
  }
  const std::vector<std::int64_t> numbers = NumbersAt(names, *place);
  std::int64_t step = 0;
  for (std::size_t i = 1; i < numbers.size(); ++i) {
    step = std::gcd(step, numbers[i] - numbers[i - 1]);
  }
  // Too few for what there were: perhaps the distance of two is that over a gap.
  const std::int64_t span = numbers.back() - numbers.front();
  const auto least_span = static_cast<std::int64_t>(least_count) - 1;
  if (step > 0 && span / step < least_span) {
    step = span == least_span ? 1 : 0;
  }
  std::vector<std::string> missing;
  for (std::size_t i = 1; step > 0 && i < numbers.size(); ++i) {
    for (std::int64_t number = numbers[i - 1] + step;
         number < numbers[i] && missing.size() < kMaxNamed; number += step) {
      missing.push_back(BaseName(WithNumber(files[i - 1], *place, number)));
    }
  }
  return missing;
}

}  // namespace isoscope::source
