#include "client-cli/session/series_flags.h"

#include <cstdint>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

#include "clients/cpp/request/parse_value.h"
#include "core/cli/flags.h"
#include "core/store/series_manifest.h"

namespace isoscope::cli {

absl::StatusOr<source::StepRange> ParseStepRange(absl::string_view text) {
  const std::vector<std::string> parts = absl::StrSplit(text, ':');
  std::vector<int> numbers;
  for (const std::string& part : parts) {
    const absl::StatusOr<std::int64_t> number = client::ParseInteger(part, 0, store::kMaxSteps - 1);
    if (number.ok()) {
      numbers.push_back(static_cast<int>(*number));
    }
  }
  if (numbers.size() != parts.size() || numbers.size() > 3 ||
      (numbers.size() > 1 && numbers[0] > numbers[1]) || (numbers.size() > 2 && numbers[2] < 1)) {
    return absl::InvalidArgumentError(absl::StrCat(
        "'", text, "' is neither a step N nor a range A:B or A:B:S of steps, the first one 0"));
  }
  return source::StepRange{.first = numbers[0],
                           .last = numbers.size() > 1 ? numbers[1] : numbers[0],
                           .stride = numbers.size() > 2 ? numbers[2] : 1};
}

void AddSeriesFlags(FlagSet* set, SeriesFlags* flags) {
  const auto add = [](Flag flag) { flag.Group("Fields and time steps"); };
  add(AddRepeatableFlag(set, "--field", "NAME", &flags->fields, ParseText,
                        "a field of the source, or the name of the only one of a format without "
                        "names; may be repeated (default: all)"));
  add(AddFlag(set, "--step", "N|A:B[:S]", &flags->steps, ParseStepRange,
              "steps of the source: A, A + S, ..., up to and with B (default: all)"));
  add(AddFlag(set, "--time", "VALUE", &flags->time, client::ParseNumber,
              "the time of a source that has none"));
}

source::OpenRequest RequestOf(const SourceFlags& source, const SeriesFlags& series,
                              const std::string& path) {
  source::OpenRequest request = RequestOf(source, path);
  request.fields = series.fields;
  request.steps = series.steps;
  request.time = series.time;
  return request;
}

}  // namespace isoscope::cli
