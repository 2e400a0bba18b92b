#include "core/source/series_selection.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/check.h"
#include "core/base/shell_word.h"
#include "core/base/status_macros.h"

namespace isoscope::source {
namespace {

class SelectedSeries final : public VolumeSeries {
 public:
  SelectedSeries(SeriesInfo info, std::unique_ptr<VolumeSeries> source, std::vector<int> fields,
                 std::vector<int> steps)
      : VolumeSeries(std::move(info)),
        source_(std::move(source)),
        field_indices_(std::move(fields)),
        step_numbers_(std::move(steps)) {}

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    return source_->Open(field_indices_[static_cast<std::size_t>(field)], component,
                         step_numbers_[static_cast<std::size_t>(step)]);
  }
  absl::StatusOr<std::optional<std::vector<std::string>>> FilesOfStep(int step) override {
    return source_->FilesOfStep(step_numbers_[static_cast<std::size_t>(step)]);
  }
  absl::StatusOr<std::string> IdentityOfStep(int step) override {
    return source_->IdentityOfStep(step_numbers_[static_cast<std::size_t>(step)]);
  }

 private:
  const std::unique_ptr<VolumeSeries> source_;
  const std::vector<int> field_indices_;  // in source_
  const std::vector<int> step_numbers_;   // in source_
};

absl::StatusOr<std::vector<int>> ChooseFields(const SeriesInfo& source,
                                              const SeriesSelection& selection) {
  const std::vector<SourceField>& all = source.fields;
  std::vector<int> chosen;
  if (selection.fields.empty() || selection.names_field) {
    for (int field = 0; field < static_cast<int>(all.size()); ++field) {
      chosen.push_back(field);
    }
  }
  if (selection.names_field && !selection.fields.empty() &&
      (all.size() > 1 || selection.fields.size() > 1)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: has %d fields without names: the names of %d were given", source.name,
                        all.size(), selection.fields.size()));
  }
  for (std::size_t i = 0; i < selection.fields.size() && !selection.names_field; ++i) {
    const auto found = std::find_if(all.begin(), all.end(), [&](const SourceField& field) {
      return field.name == selection.fields[i];
    });
    if (found == all.end()) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: no field \"%s\"; it has %s%s", source.name, selection.fields[i],
                          absl::StrJoin(all, ", ",
                                        [](std::string* out, const SourceField& field) {
                                          absl::StrAppend(out, "\"", field.name, "\"");
                                        }),
                          OtherGridAdvice(source, selection.fields[i])));
    }
    const auto index = static_cast<int>(found - all.begin());
    if (std::find(chosen.begin(), chosen.end(), index) != chosen.end()) {
      return absl::InvalidArgumentError(
          absl::StrFormat("field \"%s\" is given twice", selection.fields[i]));
    }
    chosen.push_back(index);
  }
  return chosen;
}

absl::StatusOr<std::vector<int>> ChooseSteps(const SeriesInfo& source,
                                             const std::optional<StepRange>& range) {
  const int step_count = source.step_count();
  const StepRange steps = range.value_or(StepRange{.first = 0, .last = step_count - 1});
  if (steps.last >= step_count) {
    return absl::InvalidArgumentError(absl::StrFormat("%s: step %d: the source has steps 0 to %d",
                                                      source.name, steps.last, step_count - 1));
  }
  std::vector<int> chosen;
  for (int step = steps.first; step <= steps.last; step += steps.stride) {
    chosen.push_back(step);
  }
  return chosen;
}

}  // namespace

std::string OtherGridAdvice(const SeriesInfo& source, absl::string_view field) {
  for (const std::string& name : source.fields_elsewhere) {
    if (field == name || absl::StartsWith(field, absl::StrCat(name, ":"))) {
      return absl::StrCat("; it lies on another grid: open ",
                          base::ShellWord(absl::StrCat(source.name, ":", name)));
    }
  }
  return "";
}

std::string OtherGridsNote(const SeriesInfo& source) {
  constexpr std::size_t kMaxNamed = 5;
  const std::vector<std::string>& names = source.fields_elsewhere;
  if (names.empty()) {
    return "";
  }
  const std::size_t named = std::min(names.size(), kMaxNamed);
  std::string text = absl::StrJoin(
      names.begin(), names.begin() + static_cast<std::ptrdiff_t>(named), ", ",
      [](std::string* out, const std::string& name) { absl::StrAppend(out, "\"", name, "\""); });
  if (names.size() > named) {
    absl::StrAppend(&text, " and ", names.size() - named, " more");
  }
  return absl::StrCat(
      text, names.size() == 1 ? " lies on another grid: open " : " lie on other grids: open ",
      base::ShellWord(absl::StrCat(source.name, ":", names.front())),
      names.size() == 1 ? "" : ", or another of them");
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> SelectFrom(std::unique_ptr<VolumeSeries> source,
                                                         const SeriesSelection& selection) {
  SeriesInfo info = source->info();
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<int> fields, ChooseFields(info, selection));
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<int> steps, ChooseSteps(info, selection.steps));
  if (selection.time.has_value() && !info.times.empty()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: a time was given, but the source has times of its own, %g to %g",
                        info.name, info.times.front(), info.times.back()));
  }
  info.fields.clear();
  for (const int field : fields) {
    info.fields.push_back(source->info().field(field));
  }
  if (selection.names_field && !selection.fields.empty()) {
    info.fields.front().name = selection.fields.front();
  }
  if (!info.times.empty()) {
    info.times.clear();
    for (const int step : steps) {
      info.times.push_back(source->info().times[static_cast<std::size_t>(step)]);
    }
  }
  if (selection.time.has_value()) {
    ISOSCOPE_CHECK(std::isfinite(*selection.time));
    info.times = {*selection.time};
  }
  return std::make_unique<SelectedSeries>(std::move(info), std::move(source), std::move(fields),
                                          std::move(steps));
}

}  // namespace isoscope::source
