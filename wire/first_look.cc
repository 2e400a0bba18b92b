#include "wire/first_look.h"

#include <numbers>

#include "core/view/camera_fit.h"

namespace isoscope::wire {

namespace v1 = isoscope::v1;

const v1::FirstLook& GetFirstLook() {
  return v1::RenderIsosurfaceRequest::descriptor()->options().GetExtension(v1::first_look);
}

view::Camera FirstLookCamera(const math::Box3d& bounds,
                             const std::optional<volume::PatientFrame>& patient_frame) {
  constexpr double kRadiansPerDegree = std::numbers::pi / 180;
  const v1::FirstLook& look = GetFirstLook();
  return view::MakeFirstLookCamera(look.azimuth_degrees() * kRadiansPerDegree,
                                   look.elevation_degrees() * kRadiansPerDegree, bounds,
                                   patient_frame);
}

void AddFirstMaterial(v1::RenderIsosurfaceRequest* request) {
  const v1::FirstLook& look = GetFirstLook();
  for (v1::Surface& surface : *request->mutable_surfaces()) {
    if (!surface.has_material()) {
      surface.mutable_material()->set_diffuse(look.diffuse());
      surface.mutable_material()->set_specular(look.specular());
      surface.mutable_material()->set_shininess(look.shininess());
    }
  }
}

}  // namespace isoscope::wire
