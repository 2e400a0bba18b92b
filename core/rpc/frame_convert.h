// A frame on the wire and in core types. A new parameter of a frame is checked and converted here,
// and nowhere else.

#ifndef ISOSCOPE_CORE_RPC_FRAME_CONVERT_H_
#define ISOSCOPE_CORE_RPC_FRAME_CONVERT_H_

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/frame/frame_spec.h"
#include "core/frame/picture_revision.h"
#include "core/math/box.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::rpc {

// Checks all of a request that does not depend on the dataset, unknown fields among it. The camera
// stays unset if the request has none. The same message gives the same bits on every machine.
// INVALID_ARGUMENT names the field, its value and what is allowed.
absl::StatusOr<frame::FrameSpec> FrameSpecFromProto(
    const isoscope::v1::RenderIsosurfaceRequest& request);

// Gives a request without a camera the default one of `bounds`, and `spec` what the agents will
// read from the message: the same bits everywhere.
absl::Status ResolveCamera(const math::Box3d& bounds,
                           isoscope::v1::RenderIsosurfaceRequest* request, frame::FrameSpec* spec);

// INVALID_ARGUMENT if the back end is none that this program knows, or the number is below 1.
absl::StatusOr<frame::PictureRevision> PictureRevisionFromProto(
    const isoscope::internal::v1::PictureRevision& proto, absl::string_view path);
isoscope::internal::v1::PictureRevision ToProto(const frame::PictureRevision& revision);

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_CORE_RPC_FRAME_CONVERT_H_
