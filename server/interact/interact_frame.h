// The frames of an interactive stream, made from the state of its view.

#ifndef ISOSCOPE_SERVER_INTERACT_INTERACT_FRAME_H_
#define ISOSCOPE_SERVER_INTERACT_INTERACT_FRAME_H_

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"

#include "core/frame/frame_spec.h"
#include "isoscope/v1/interact_service.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "server/interact/rate_control.h"
#include "wire/frame_convert.h"

namespace isoscope::server {

// Of the coarse frame of a view at rest, where the network carries moving frames of full quality:
// it stays beside exact tiles, and at the usual quality its background differs from theirs.
inline constexpr int kRestJpegQuality = 95;

// Returns the quality of the coarse frame of a view at rest: of full size.
MovingQuality RestQualityOf(MovingQuality moving);

// Returns true if `next` asks for the picture of `frame`, with the camera that an answer to that told
// in place of what the server had to choose. No client needs to have it drawn again.
bool HasToldCamera(const isoscope::v1::RenderIsosurfaceRequest& frame,
                   const isoscope::v1::Camera& told,
                   const isoscope::v1::RenderIsosurfaceRequest& next);

// Returns the exact frame of a state. Errors as wire::AskedFrameFromProto; INVALID_ARGUMENT also
// because of the output that the state asks for.
absl::StatusOr<wire::AskedFrame> ExactFrameOf(const isoscope::v1::ViewState& state);

// Returns the moving frame of a state: a JPEG of one sample, without notes. Its sides, and lengths
// in pixels, are multiplied by `quality.scale`. A region keeps its size, because its borders would
// fall between pixels. Errors as ExactFrameOf; also where a JPEG has none of what is asked for.
absl::StatusOr<wire::AskedFrame> MovingFrameOf(const isoscope::v1::ViewState& state,
                                               const MovingQuality& quality);
// The same, made smaller until it is drawn at once: bands would take longer than moving views have.
// A frame of a region keeps its size.
//
// is_drawn_at_once: whether a frame is; if so, each smaller one is, too
absl::StatusOr<wire::AskedFrame> MovingFrameOf(
    const isoscope::v1::ViewState& state, const MovingQuality& quality,
    absl::FunctionRef<bool(const frame::FrameSpec& spec)> is_drawn_at_once);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_INTERACT_INTERACT_FRAME_H_
