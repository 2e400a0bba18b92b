// A source may have many fields and steps; a command needs some of them. ChooseVolumes:
//
//   1. Find the field and component of --field; the first field without it.
//   2. Choose the steps: those of a sweep, --time (the nearest), --step, or the last.
//   3. Add the volumes of the field and of the fields that colour surfaces. Colours without a range
//      need all steps, because their range is that of all, unless --color-range says that of the step.
//   4. Say in a note what no flag has chosen.
//
// The text of the choice is a part of the name in the cache. It is "" for the first field at the
// last step, and counts the bytes of names, so that no two choices have one text.

#include "client-cli/session/wanted_volumes.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <map>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "core/base/status_macros.h"
#include "core/cli/usage.h"
#include "core/source/series_parts.h"
#include "core/source/series_selection.h"
#include "core/store/series_manifest.h"
#include "core/volume/field_name.h"

namespace isoscope::cli {
namespace {

using source::SourceField;
using source::VolumeSeries;

absl::StatusOr<int> FindField(const std::string& text, const VolumeSeries& source) {
  const std::vector<SourceField>& fields = source.info().fields;
  const auto found =
      volume::FindFieldName(text, [&](absl::string_view name) -> std::optional<std::size_t> {
        const auto field = std::find_if(fields.begin(), fields.end(),
                                        [&](const SourceField& f) { return f.name == name; });
        return field == fields.end()
                   ? std::nullopt
                   : std::optional<std::size_t>(static_cast<std::size_t>(field - fields.begin()));
      });
  if (!found.has_value()) {
    std::vector<std::string> known;
    for (const SourceField& field : fields) {
      known.push_back(field.name);
    }
    std::string nearest = NearestName(text, known);
    if (nearest.empty()) {
      nearest = NearestName(text.substr(0, text.find(':')), known);
    }
    return absl::InvalidArgumentError(
        absl::StrCat(source.info().name, ": no field \"", text, "\"; it has ",
                     source::DescribeFields(fields), source::OtherGridAdvice(source.info(), text),
                     nearest.empty() ? "" : absl::StrCat("; did you mean \"", nearest, "\"?")));
  }
  // A number names a component, too.
  const std::vector<std::string>& components = fields[found->field].components;
  std::size_t number = 0;
  const bool is_component =
      std::find(components.begin(), components.end(), found->component) != components.end() ||
      (components.size() > 1 &&
       (found->component == store::kMagnitudeName ||
        (absl::SimpleAtoi(found->component, &number) && number < components.size())));
  if (!found->component.empty() && !is_component) {
    return absl::InvalidArgumentError(absl::StrCat(
        source.info().name, ": field \"", fields[found->field].name, "\" has no component \"",
        found->component, "\"; it has ",
        components.size() > 1 ? absl::StrCat(absl::StrJoin(components, ", "), " and magnitude")
                              : "one, without a name"));
  }
  return static_cast<int>(found->field);
}

// The nearest step; of two the earlier (wire::ChooseStep has the same rule).
int NearestStep(double time, const std::vector<double>& times) {
  const auto next = std::lower_bound(times.begin(), times.end(), time);
  if (next == times.begin()) {
    return 0;
  }
  const auto before = static_cast<int>(next - times.begin()) - 1;
  return next == times.end() || time - *(next - 1) <= *next - time ? before : before + 1;
}

absl::StatusOr<std::vector<int>> ChooseSteps(const WantedVolumes& wanted,
                                             const VolumeSeries& source) {
  const int count = source.info().step_count();
  if (wanted.steps) {
    return wanted.steps(count);
  }
  const client::SelectionFlags& selection = wanted.selection;
  if (selection.time) {
    if (source.info().times.empty()) {
      return absl::InvalidArgumentError(
          absl::StrCat(source.info().name, ": --time ", *selection.time,
                       ": it has one step, without a time; leave --time out"));
    }
    return std::vector<int>{NearestStep(*selection.time, source.info().times)};
  }
  const std::int64_t step = selection.step.value_or(-1);
  if (step >= count) {
    return absl::NotFoundError(
        absl::StrCat(source.info().name, ": --step ", step, ": it has ",
                     count == 1 ? "step 0 alone" : absl::StrCat("steps 0 to ", count - 1)));
  }
  return std::vector<int>{step < 0 ? count - 1 : static_cast<int>(step)};
}

// "p 3,4; T all". Names are quoted by their length.
std::string TextOf(const std::set<std::pair<int, int>>& volumes, const VolumeSeries& source) {
  std::map<int, std::vector<int>> steps;
  for (const auto& [field, step] : volumes) {
    steps[field].push_back(step);
  }
  std::string text;
  for (const auto& [field, field_steps] : steps) {
    const std::string& name = source.info().field(field).name;
    const bool has_all = static_cast<int>(field_steps.size()) == source.info().step_count();
    absl::StrAppend(&text, name.size(), " ", name, " ",
                    has_all ? "all" : absl::StrJoin(field_steps, ","), "; ");
  }
  return text;
}

ChosenVolumes Finish(std::set<std::pair<int, int>> volumes, const VolumeSeries& source) {
  ChosenVolumes chosen;
  const bool is_default =
      volumes == std::set<std::pair<int, int>>{{0, source.info().step_count() - 1}};
  chosen.text = is_default ? "" : TextOf(volumes, source);
  for (int field = 0; field < static_cast<int>(source.info().fields.size()); ++field) {
    if (std::any_of(volumes.begin(), volumes.end(),
                    [&](const auto& volume) { return volume.first == field; })) {
      chosen.fields.push_back(source.info().field(field).name);
    }
  }
  chosen.volumes = std::move(volumes);
  return chosen;
}

// Returns a note on the choices that no flag has made.
std::string NoteOf(const WantedVolumes& wanted, int field, const std::vector<int>& steps,
                   const VolumeSeries& source) {
  const std::vector<SourceField>& fields = source.info().fields;
  std::vector<std::string> parts;
  std::vector<std::string> flags;
  if (fields.size() > 1 && !wanted.selection.field) {
    parts.push_back(absl::StrCat("field \"", fields[static_cast<std::size_t>(field)].name, "\" of ",
                                 source::DescribeFields(fields)));
    flags.emplace_back("--field");
  }
  const bool has_step = wanted.steps || wanted.selection.step || wanted.selection.time;
  if (source.info().step_count() > 1 && !has_step) {
    parts.push_back(absl::StrCat("step ", steps[0], " of 0 to ", source.info().step_count() - 1));
    flags.emplace_back("--step");
  }
  return parts.empty() ? ""
                       : absl::StrCat("takes ", absl::StrJoin(parts, ", "), "; ",
                                      absl::StrJoin(flags, " and "),
                                      flags.size() == 1 ? " chooses" : " choose");
}

// Whether the map of caps without a range of its own has that of all steps. A window is that of the
// step, and render asks for one by itself.
bool CapsNeedAllSteps(const client::LookFlags& look) {
  if (look.cap_window.has_value()) {
    return !look.cap_window->percentiles.has_value();
  }
  return look.color_range.has_value() && *look.color_range != frame::RangeSource::kStep;
}

}  // namespace

void AddColors(const client::LookFlags& look, const std::optional<frame::ClipCaps>& caps,
               WantedVolumes* wanted) {
  for (const client::ColorByValue& value : look.color_by) {
    if (!value.color_by.has_value()) {
      continue;
    }
    const bool has_range =
        value.color_by->range.has_value() || look.color_range == frame::RangeSource::kStep;
    if (!value.field.empty()) {
      wanted->colors.push_back({.text = value.component.empty()
                                            ? value.field
                                            : absl::StrCat(value.field, ":", value.component),
                                .needs_all_steps = !has_range});
    } else if (value.color_by->quantity == frame::ColorBy::Quantity::kGradientMagnitude) {
      wanted->needs_all_steps = wanted->needs_all_steps || !has_range;
    }
  }
  if (caps.has_value() && caps->map.has_value() && !caps->range.has_value()) {
    wanted->needs_all_steps = wanted->needs_all_steps || CapsNeedAllSteps(look);
  }
}

absl::StatusOr<ChosenVolumes> ChooseVolumes(const WantedVolumes& wanted,
                                            const VolumeSeries& source) {
  std::string text = wanted.selection.field ? wanted.selection.field->name : "";
  if (wanted.selection.field && !wanted.selection.field->component.empty()) {
    absl::StrAppend(&text, ":", wanted.selection.field->component);
  }
  int main_field = 0;
  if (!text.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(main_field, FindField(text, source));
  }
  if (wanted.selection.component) {
    ISOSCOPE_RETURN_IF_ERROR(FindField(absl::StrCat(source.info().field(main_field).name, ":",
                                                    *wanted.selection.component),
                                       source)
                                 .status());
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<int> steps, ChooseSteps(wanted, source));
  std::set<std::pair<int, int>> volumes;
  const auto add = [&](int field, bool needs_all_steps) {
    for (const int step : steps) {
      volumes.emplace(field, step);
    }
    for (int step = 0; needs_all_steps && step < source.info().step_count(); ++step) {
      volumes.emplace(field, step);
    }
  };
  add(main_field, wanted.needs_all_steps);
  for (const WantedField& color : wanted.colors) {
    ISOSCOPE_ASSIGN_OR_RETURN(const int field, FindField(color.text, source));
    add(field, color.needs_all_steps);
  }
  for (int field = 0;
       wanted.needs_all_fields && field < static_cast<int>(source.info().fields.size()); ++field) {
    add(field, false);
  }
  ChosenVolumes chosen = Finish(std::move(volumes), source);
  chosen.note = NoteOf(wanted, main_field, steps, source);
  return chosen;
}

ChosenVolumes ChooseAllVolumes(const VolumeSeries& source) {
  std::set<std::pair<int, int>> volumes;
  for (int field = 0; field < static_cast<int>(source.info().fields.size()); ++field) {
    for (int step = 0; step < source.info().step_count(); ++step) {
      volumes.emplace(field, step);
    }
  }
  return Finish(std::move(volumes), source);
}

}  // namespace isoscope::cli
