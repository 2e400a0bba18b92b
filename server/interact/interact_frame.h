// The requests of an interactive stream's frames, made from the state of its view.

#ifndef ISOSCOPE_SERVER_INTERACT_INTERACT_FRAME_H_
#define ISOSCOPE_SERVER_INTERACT_INTERACT_FRAME_H_

#include "absl/status/status.h"

#include "isoscope/v1/interact_service.pb.h"
#include "server/interact/rate_control.h"

namespace isoscope::server {

// INVALID_ARGUMENT if a state can't be rendered because of the output that it asks for.
absl::Status CheckInteractiveOutput(const isoscope::v1::ViewState& state);

// Returns the request of a moving frame: a JPEG of one sample. Its sides, and lengths in pixels,
// are multiplied by `quality.scale`. A region keeps its size, because its borders would fall
// between pixels.
isoscope::v1::RenderIsosurfaceRequest MovingRequest(
    const isoscope::v1::RenderIsosurfaceRequest& request, const MovingQuality& quality);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_INTERACT_INTERACT_FRAME_H_
