// The first look at a dataset: what programs for people ask for where people ask for no camera. The
// proto has the one table of it, for clients in all languages (isoscope/v1/options.proto).

#ifndef ISOSCOPE_WIRE_FIRST_LOOK_H_
#define ISOSCOPE_WIRE_FIRST_LOOK_H_

#include <optional>

#include "core/math/box.h"
#include "core/view/camera.h"
#include "core/volume/patient_frame.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "isoscope/v1/options.pb.h"

namespace isoscope::wire {

// Returns the table. It lives as long as the program.
const isoscope::v1::FirstLook& GetFirstLook();

// Returns its camera, at the distance of the default camera of `bounds`.
view::Camera FirstLookCamera(const math::Box3d& bounds,
                             const std::optional<volume::PatientFrame>& patient_frame);

// Gives the first look's material to each surface of a request that has none of its own. REQUIRES: the
// request lists its surfaces.
void AddFirstMaterial(isoscope::v1::RenderIsosurfaceRequest* request);

}  // namespace isoscope::wire

#endif  // ISOSCOPE_WIRE_FIRST_LOOK_H_
