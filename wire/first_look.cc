#include "wire/first_look.h"

namespace isoscope::wire {

namespace v1 = isoscope::v1;

const v1::FirstLook& GetFirstLook() {
  return v1::RenderIsosurfaceRequest::descriptor()->options().GetExtension(v1::first_look);
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
