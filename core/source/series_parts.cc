#include "core/source/series_parts.h"

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/status_macros.h"
#include "core/volume/field_name.h"

namespace isoscope::source {
namespace {

// One field of a series, or one component of it.
class PartSeries final : public VolumeSeries {
 public:
  PartSeries(std::unique_ptr<VolumeSeries> whole, int field, std::optional<int> component)
      : VolumeSeries(InfoOf(whole->info(), field, component.has_value())),
        whole_(std::move(whole)),
        field_(field),
        component_(component) {}

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int /*field*/, int component,
                                                     int step) override {
    return whole_->Open(field_, component_.value_or(component), step);
  }
  absl::StatusOr<std::optional<std::vector<std::string>>> FilesOfStep(int step) override {
    return whole_->FilesOfStep(step);
  }

 private:
  static SeriesInfo InfoOf(SeriesInfo info, int field, bool is_component) {
    info.fields = {info.field(field)};
    info.fields_elsewhere.clear();
    if (is_component) {
      info.fields[0].components = {""};
    }
    return info;
  }

  const std::unique_ptr<VolumeSeries> whole_;
  const int field_;
  const std::optional<int> component_;
};

// -1 if there is none.
int FieldNumber(const std::vector<SourceField>& fields, absl::string_view name) {
  const auto found = std::find_if(fields.begin(), fields.end(),
                                  [&](const SourceField& field) { return field.name == name; });
  return found == fields.end() ? -1 : static_cast<int>(found - fields.begin());
}

int ComponentNumber(const std::vector<std::string>& components, absl::string_view name) {
  const auto found = std::find(components.begin(), components.end(), name);
  int number = -1;
  if (found != components.end()) {
    return static_cast<int>(found - components.begin());
  }
  return absl::SimpleAtoi(name, &number) && number < static_cast<int>(components.size()) ? number
                                                                                         : -1;
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSeries>> SelectPart(std::unique_ptr<VolumeSeries> series,
                                                         const std::string& file,
                                                         const std::string& part) {
  const std::vector<SourceField>& fields = series->info().fields;
  const std::optional<volume::FieldName> name =
      volume::FindFieldName(part, [&](absl::string_view text) -> std::optional<std::size_t> {
        const int field = FieldNumber(fields, text);
        return field < 0 ? std::nullopt : std::optional(static_cast<std::size_t>(field));
      });
  std::optional<int> component;
  if (name.has_value() && !name->component.empty()) {
    component = ComponentNumber(fields[name->field].components, name->component);
  }
  if (!name.has_value() || component.value_or(0) < 0) {
    return absl::NotFoundError(absl::StrFormat("%s: no %s \"%s\"; it holds %s", file,
                                               name.has_value() ? "component" : "field", part,
                                               DescribeFields(fields)));
  }
  return std::make_unique<PartSeries>(std::move(series), static_cast<int>(name->field), component);
}

std::string DescribeFields(const std::vector<SourceField>& fields) {
  constexpr std::size_t kMaxListed = 50;
  std::vector<std::string> texts;
  for (const SourceField& field : fields) {
    if (texts.size() == kMaxListed) {
      texts.emplace_back("and more");
      break;
    }
    texts.push_back(absl::StrCat(
        field.name, field.unit.empty() ? "" : absl::StrCat(" [", field.unit, "]"),
        field.components.size() > 1 ? absl::StrCat(" (", absl::StrJoin(field.components, ", "), ")")
                                    : ""));
  }
  return absl::StrJoin(texts, ", ");
}

std::string DescribeSteps(const std::vector<double>& times, const std::string& unit) {
  return times.empty() ? "1, without a time"
                       : absl::StrCat(times.size(), ", from ", times.front(), " to ", times.back(),
                                      unit.empty() ? "" : " ", unit);
}

bool IsOneVolume(const SeriesInfo& series) {
  return series.fields.size() == 1 && series.fields[0].components.size() == 1 &&
         series.step_count() == 1;
}

std::vector<std::string> ComponentNames(std::int64_t count) {
  if (count == 1) {
    return {""};
  }
  std::vector<std::string> names;
  for (std::int64_t i = 0; i < count; ++i) {
    names.push_back(count == 3 ? std::string(1, "xyz"[i]) : absl::StrCat(i));
  }
  return names;
}

}  // namespace isoscope::source
