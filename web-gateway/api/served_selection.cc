#include "web-gateway/api/served_selection.h"

#include <algorithm>

#include "absl/strings/str_cat.h"

namespace isoscope::gateway {

namespace v1 = isoscope::v1;

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

namespace {

// Whether the ends of a range follow from those of all steps: what is visible is found within them.
template <typename Map>
bool HasRangeOfAllSteps(const Map& map) {
  return !map.has_range() || map.range().source() == v1::ColorRange::SOURCE_VISIBLE;
}

}  // namespace

std::string RangesOfColors(const v1::RenderIsosurfaceRequest& request, const v1::Dataset& dataset) {
  const bool has_all =
      !(request.has_caps() && request.caps().color_map() != v1::COLOR_MAP_UNSPECIFIED &&
        HasRangeOfAllSteps(request.caps())) &&
      std::all_of(request.surfaces().begin(), request.surfaces().end(),
                  [](const v1::Surface& surface) {
                    return !surface.has_color_by() || !HasRangeOfAllSteps(surface.color_by());
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
