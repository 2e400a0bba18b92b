// The texts:
//
//   times=0 0.05 0.1 ...     none if there is no time
//   time_unit=s
//   length_unit=m
//   distances_z=0 2 3 6      only of an axis that is not even: where its samples lie
//   elsewhere=v              a field on another grid
//   field=u                  begins a field
//   number=3                 by which the child knows it
//   unit=, long_name=
//   component=x              once for each component; none for a scalar field
//
// A volume is then asked for by its part: "3 0 2 so-", number, step and component, and which of
// spacing, origin and direction the user gives.

#include "core/source/child/walled_series.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <set>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kMaxWalledSteps = 100'000;
constexpr std::size_t kMaxWalledComponents = 4096;

bool TakeTimes(const std::string& value, std::vector<double>* times) {
  for (const absl::string_view word : absl::StrSplit(value, ' ', absl::SkipEmpty())) {
    double& time = times->emplace_back();
    if (!absl::SimpleAtod(word, &time) || !std::isfinite(time) ||
        (times->size() > 1 && !(time > (*times)[times->size() - 2]))) {
      return false;
    }
  }
  return times->size() <= kMaxWalledSteps;
}

// ResampleSource checks that they ascend, and their number.
bool TakeDistances(const std::string& value, std::vector<double>* distances) {
  for (const absl::string_view word : absl::StrSplit(value, ' ', absl::SkipEmpty())) {
    if (!absl::SimpleAtod(word, &distances->emplace_back())) {
      return false;
    }
  }
  return true;
}

std::string JoinedNumbers(const std::vector<double>& numbers) {
  return absl::StrJoin(numbers, " ", [](std::string* out, double number) {
    absl::StrAppendFormat(out, "%.17g", number);
  });
}

// False if the text makes no sense.
bool TakeText(const std::string& text, WalledFile* file) {
  const std::pair<std::string, std::string> pair = absl::StrSplit(text, absl::MaxSplits('=', 1));
  const auto& [key, value] = pair;
  if (key == "length_unit" || key == "time_unit") {
    (key == "time_unit" ? file->info.time_unit : file->info.length_unit) = value;
    return true;
  }
  if (key == "times") {
    return TakeTimes(value, &file->info.times);
  }
  if (absl::StartsWith(key, "distances_") && key.size() == 11 && key[10] >= 'x' && key[10] <= 'z') {
    return TakeDistances(value, &file->distances[static_cast<std::size_t>(key[10] - 'x')]);
  }
  if (key == "elsewhere") {
    file->info.fields_elsewhere.push_back(value);
    return !value.empty();
  }
  if (key == "field") {
    file->Add({.name = value, .components = {}}, 0);
    return !value.empty();
  }
  if (file->numbers.empty()) {
    return false;
  }
  SourceField& last = file->info.fields.back();
  if (key == "number") {
    return absl::SimpleAtoi(value, &file->numbers.back()) && file->numbers.back() >= 0;
  }
  if (key == "component") {
    last.components.push_back(value);
    return !value.empty() && last.components.size() <= kMaxWalledComponents;
  }
  (key == "unit" ? last.unit : last.long_name) = value;
  return key == "unit" || key == "long_name";
}

bool AreUnique(const std::vector<std::string>& names) {
  return std::set<std::string>(names.begin(), names.end()).size() == names.size();
}

// Completes the fields; false if their names make no sense.
bool Complete(WalledFile* file) {
  std::vector<std::string> names;
  for (SourceField& field : file->info.fields) {
    names.push_back(field.name);
    std::vector<std::string>& components = field.components;
    if (components.size() == 1 || !AreUnique(components)) {
      return false;
    }
    if (components.empty()) {
      components = {""};
    }
  }
  return !names.empty() && AreUnique(names);
}

class WalledSeries final : public VolumeSeries {
 public:
  WalledSeries(const WalledLibrary& library, WalledFile file, const GridRules& rules,
               WrapWalled wrap)
      : VolumeSeries(file.info),
        library_(library),
        file_(std::move(file)),
        rules_(rules),
        wrap_(wrap) {}

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    const std::string part = absl::StrCat(file_.numbers[static_cast<std::size_t>(field)], " ", step,
                                          " ", component, " ", GivenWord(rules_));
    ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> source,
                              OpenWalled(library_, info().name, part));
    if (rules_.resamples) {
      return ResampleSource(std::move(source), file_.distances, rules_.fill);
    }
    return wrap_ == nullptr ? std::move(source) : wrap_(std::move(source), info().name, part);
  }

 private:
  const WalledLibrary library_;
  const WalledFile file_;
  const GridRules rules_;
  const WrapWalled wrap_;
};

}  // namespace

std::vector<std::string> WalledTexts(const WalledFile& file) {
  std::vector<std::string> texts{absl::StrCat("times=", JoinedNumbers(file.info.times)),
                                 absl::StrCat("time_unit=", file.info.time_unit),
                                 absl::StrCat("length_unit=", file.info.length_unit)};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (!file.distances[axis].empty()) {
      texts.push_back(absl::StrCat("distances_", std::string(1, "xyz"[axis]), "=",
                                   JoinedNumbers(file.distances[axis])));
    }
  }
  for (const std::string& name : file.info.fields_elsewhere) {
    texts.push_back(absl::StrCat("elsewhere=", name));
  }
  for (std::size_t i = 0; i < file.numbers.size(); ++i) {
    const SourceField& field = file.info.fields[i];
    texts.push_back(absl::StrCat("field=", field.name));
    texts.push_back(absl::StrCat("number=", file.numbers[i]));
    texts.push_back(absl::StrCat("unit=", field.unit));
    texts.push_back(absl::StrCat("long_name=", field.long_name));
    for (const std::string& component : field.components) {
      if (field.components.size() > 1) {
        texts.push_back(absl::StrCat("component=", component));
      }
    }
  }
  return texts;
}

std::array<std::int64_t, 3> ParseWalledPart(const std::string& part) {
  std::array<std::int64_t, 3> numbers{};
  const std::vector<std::string> words = absl::StrSplit(part, ' ');
  ISOSCOPE_CHECK(words.size() == numbers.size() + 1);
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    ISOSCOPE_CHECK(absl::SimpleAtoi(words[i], &numbers[i]));
  }
  return numbers;
}

GridRules GivenRules(absl::string_view part) {
  const absl::string_view word = part.substr(part.rfind(' ') + 1);
  return {.has_spacing = absl::StrContains(word, 's'),
          .has_origin = absl::StrContains(word, 'o'),
          .has_direction = absl::StrContains(word, 'd')};
}

std::string GivenWord(const GridRules& rules) {
  return absl::StrCat(rules.has_spacing ? "s" : "-", rules.has_origin ? "o" : "-",
                      rules.has_direction ? "d" : "-");
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenWalledSeries(const WalledLibrary& library,
                                                               const std::string& file,
                                                               const std::string& part,
                                                               const GridRules& rules,
                                                               WrapWalled wrap) {
  constexpr std::size_t kMaxPart = 255;
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> texts,
                            DescribeWalled(library, file, part.substr(0, kMaxPart)));
  if (texts.empty()) {
    return nullptr;
  }
  WalledFile described;
  const bool makes_sense = std::all_of(texts.begin(), texts.end(), [&](const std::string& text) {
    return TakeText(text, &described);
  });
  if (!makes_sense || !Complete(&described)) {
    return absl::DataLossError(absl::StrFormat(
        "%s: what %s says of it makes no sense: the file is damaged", file, library.name));
  }
  described.info.name = file;
  return std::make_unique<WalledSeries>(library, std::move(described), rules, wrap);
}

}  // namespace isoscope::source
