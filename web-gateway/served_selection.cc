#include "web-gateway/served_selection.h"

#include <algorithm>
#include <vector>

#include "absl/strings/str_cat.h"

namespace isoscope::gateway {
namespace {

namespace v1 = isoscope::v1;

const v1::FieldComponent* FindComponent(const v1::Field& field, const std::string& name) {
  if (name.empty()) {
    return field.components().empty() ? nullptr : &*field.components().rbegin();
  }
  const auto found =
      std::find_if(field.components().begin(), field.components().end(),
                   [&](const v1::FieldComponent& component) { return component.name() == name; });
  return found == field.components().end() ? nullptr : &*found;
}

std::vector<const v1::TimeStep*> StepsOf(const v1::Field& field, const v1::Dataset& dataset) {
  std::vector<const v1::TimeStep*> steps;
  for (const int index : field.time_steps()) {
    if (index >= 0 && index < dataset.time_steps_size()) {
      steps.push_back(&dataset.time_steps(index));
    }
  }
  return steps;
}

// REQUIRES: there are steps, in ascending order.
const v1::TimeStep* FindStep(const std::vector<const v1::TimeStep*>& steps,
                             const v1::FieldSelection& selection) {
  if (selection.has_time()) {
    // The two neighbours alone: distances from far away would round to one number.
    const auto next = std::find_if(steps.begin(), steps.end(), [&](const v1::TimeStep* step) {
      return step->value() >= selection.time();
    });
    if (next == steps.begin() || next == steps.end()) {
      return next == steps.end() ? steps.back() : *next;
    }
    const v1::TimeStep* const before = *(next - 1);
    return selection.time() - before->value() <= (*next)->value() - selection.time() ? before
                                                                                     : *next;
  }
  if (!selection.has_time_step() || selection.time_step() == -1) {
    return steps.back();
  }
  const auto found = std::find_if(steps.begin(), steps.end(), [&](const v1::TimeStep* step) {
    return step->number() == selection.time_step();
  });
  return found == steps.end() ? nullptr : *found;
}

}  // namespace

std::optional<v1::FieldSelection> ResolveSelection(const v1::FieldSelection& selection,
                                                   const v1::Dataset& dataset) {
  const auto field =
      selection.field().empty()
          ? dataset.fields().begin()
          : std::find_if(dataset.fields().begin(), dataset.fields().end(),
                         [&](const v1::Field& one) { return one.name() == selection.field(); });
  if (field == dataset.fields().end()) {
    return std::nullopt;
  }
  const v1::FieldComponent* const component = FindComponent(*field, selection.component());
  if (component == nullptr) {
    return std::nullopt;
  }
  v1::FieldSelection resolved = selection;
  resolved.set_field(field->name());
  resolved.set_component(component->name());
  if (dataset.time_steps().empty()) {
    return resolved;
  }
  const std::vector<const v1::TimeStep*> steps = StepsOf(*field, dataset);
  const v1::TimeStep* const step = steps.empty() ? nullptr : FindStep(steps, selection);
  if (step == nullptr) {
    return std::nullopt;
  }
  resolved.set_time_step(step->number());
  return resolved;
}

std::string DigestOfStep(const v1::FieldSelection& resolved, const v1::Dataset& dataset) {
  const auto found =
      std::find_if(dataset.time_steps().begin(), dataset.time_steps().end(),
                   [&](const v1::TimeStep& step) { return step.number() == resolved.time_step(); });
  return found == dataset.time_steps().end() ? "" : found->volumes_digest();
}

bool DependsOnLaterSteps(const v1::FieldSelection& selection, const v1::Dataset& dataset) {
  return !dataset.time_steps().empty() &&
         !(selection.has_time_step() && selection.time_step() >= 0);
}

std::string RangesOfColors(const v1::RenderIsosurfaceRequest& request, const v1::Dataset& dataset) {
  const bool has_all =
      !(request.has_caps() && request.caps().color_map() != v1::COLOR_MAP_UNSPECIFIED &&
        !request.caps().has_range()) &&
      std::all_of(request.surfaces().begin(), request.surfaces().end(),
                  [](const v1::Surface& surface) {
                    return !surface.has_color_by() || surface.color_by().has_range();
                  });
  std::string ranges;
  if (has_all) {
    return ranges;
  }
  for (const v1::Field& field : dataset.fields()) {
    for (const v1::FieldComponent& component : field.components()) {
      absl::StrAppend(&ranges, component.SerializeAsString().size(), ":",
                      component.SerializeAsString());
    }
  }
  return ranges;
}

}  // namespace isoscope::gateway
