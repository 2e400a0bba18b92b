#include "clients/cpp/request/dataset_fields.h"

#include <cstddef>
#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/cli/usage.h"
#include "core/volume/field_name.h"

namespace isoscope::client {
namespace {

// Null if the dataset has no such field.
const isoscope::v1::Field* FindField(const isoscope::v1::Dataset& dataset,
                                     const std::string& name) {
  for (const isoscope::v1::Field& field : dataset.fields()) {
    if (field.name() == name || name.empty()) {
      return &field;
    }
  }
  return nullptr;
}

// INVALID_ARGUMENT if a name of the dataset is near to `typed`, which none of them is.
absl::Status SuggestField(const isoscope::v1::Dataset& dataset, absl::string_view typed) {
  std::vector<std::string> known;
  for (const isoscope::v1::Field& field : dataset.fields()) {
    known.push_back(field.name());
  }
  std::string nearest = cli::NearestName(typed, known);
  if (nearest.empty()) {
    nearest = cli::NearestName(typed.substr(0, typed.find(':')), known);
  }
  return nearest.empty()
             ? absl::OkStatus()
             : absl::InvalidArgumentError(absl::StrCat(
                   "dataset '", base::Printable(dataset.name()), "' has no field ",
                   base::Quoted(typed, '\''), ", did you mean '", base::Printable(nearest),
                   "'? `isoscope info` lists the ", known.size(), " fields"));
}

}  // namespace

absl::Status ResolveNames(const isoscope::v1::Dataset& dataset, SelectionFlags* selection,
                          LookFlags* look) {
  const auto split = [&](std::string* name, std::string* component) -> absl::Status {
    const auto found =
        volume::FindFieldName(*name, [&](absl::string_view wanted) -> std::optional<std::size_t> {
          for (int i = 0; i < dataset.fields_size(); ++i) {
            if (dataset.fields(i).name() == wanted) {
              return static_cast<std::size_t>(i);
            }
          }
          return std::nullopt;
        });
    if (!found.has_value()) {
      return SuggestField(dataset, *name);
    }
    if (component->empty()) {
      *name = dataset.fields(static_cast<int>(found->field)).name();
      *component = found->component;
    }
    return absl::OkStatus();
  };
  if (selection->field) {
    ISOSCOPE_RETURN_IF_ERROR(split(&selection->field->name, &selection->field->component));
  }
  if (look != nullptr) {
    for (ColorByValue& value : look->color_by) {
      if (!value.field.empty()) {
        ISOSCOPE_RETURN_IF_ERROR(split(&value.field, &value.component));
      }
    }
  }
  return CheckUsage(*selection);
}

isoscope::v1::Dataset DatasetOfField(isoscope::v1::Dataset dataset, const SelectionFlags& flags) {
  if (!flags.field && !flags.component) {
    return dataset;
  }
  const FieldValue field = flags.field.value_or(FieldValue());
  const std::string component_name = flags.component.value_or(field.component);
  const isoscope::v1::Field* const found = FindField(dataset, field.name);
  if (found == nullptr || found->components().empty()) {
    return dataset;
  }
  const isoscope::v1::FieldComponent* component = &found->components(found->components_size() - 1);
  for (int i = 0; i < found->components_size(); ++i) {
    if (!component_name.empty() &&
        (found->components(i).name() == component_name || absl::StrCat(i) == component_name)) {
      component = &found->components(i);
      break;
    }
  }
  const isoscope::v1::FieldComponent chosen = *component;
  dataset.set_sample_type(chosen.sample_type());
  dataset.clear_value_range();
  if (chosen.has_value_range()) {
    *dataset.mutable_value_range() = chosen.value_range();
  }
  dataset.clear_finite_range();
  if (chosen.has_finite_range()) {
    *dataset.mutable_finite_range() = chosen.finite_range();
  }
  dataset.clear_max_gradient_magnitude();
  if (chosen.has_max_gradient_magnitude()) {
    dataset.set_max_gradient_magnitude(chosen.max_gradient_magnitude());
  }
  return dataset;
}

std::string TitleOfField(const isoscope::v1::Dataset& dataset, const FieldValue& field) {
  const isoscope::v1::Field* const found = FindField(dataset, field.name);
  if (found == nullptr) {
    return "";
  }
  const std::string& name = found->long_name().empty() ? found->name() : found->long_name();
  return field.component.empty() ? name : absl::StrCat(name, " ", field.component);
}

std::string UnitOfField(const isoscope::v1::Dataset& dataset, const FieldValue& field) {
  const isoscope::v1::Field* const found = FindField(dataset, field.name);
  return found == nullptr ? "" : found->unit();
}

}  // namespace isoscope::client
