// The requests of an interactive stream's frames, made from the state of its view.

#ifndef ISOSCOPE_SERVER_INTERACT_INTERACT_FRAME_H_
#define ISOSCOPE_SERVER_INTERACT_INTERACT_FRAME_H_

#include "absl/status/status.h"

#include "isoscope/v1/interact_service.pb.h"
#include "server/interact/rate_control.h"

namespace isoscope::server {

// INVALID_ARGUMENT if a state can't be rendered as it is, because of what it asks to be sent.
absl::Status CheckInteractiveOutput(const isoscope::v1::ViewState& state);

// Returns the request of a moving frame: a JPEG of one sample, whose sides, and what is measured in
// its pixels, are smaller by `quality.scale`. A region keeps its size, because its borders would
// fall between pixels.
isoscope::v1::RenderIsosurfaceRequest MovingRequest(
    const isoscope::v1::RenderIsosurfaceRequest& request, const MovingQuality& quality);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_INTERACT_INTERACT_FRAME_H_
