// Converts bounds of depth (core/visibility/depth_bounds.h) between messages and core types.

#ifndef ISOSCOPE_WIRE_DEPTH_BOUNDS_CONVERT_H_
#define ISOSCOPE_WIRE_DEPTH_BOUNDS_CONVERT_H_

#include "absl/status/statusor.h"

#include "core/frame/frame_spec.h"
#include "core/view/camera.h"
#include "core/visibility/depth_bounds.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"

namespace isoscope::wire {

// The most parts of the blocks.
inline constexpr int kMaxBoundsParts = 65536;

// A question for bounds.
struct DepthBoundsQuery {
  frame::FrameSpec spec;  // with a camera
  int part_index = 0;
  int part_count = 1;
};

// Checks the frame as that of BeginFrame, also for unknown fields, and that its picture has at most
// frame::kMaxBoundsPixels. INVALID_ARGUMENT names the field, its value and the allowed ones.
absl::StatusOr<DepthBoundsQuery> DepthBoundsQueryFromProto(
    const isoscope::internal::v1::GetDepthBoundsRequest& request);

// Compresses the planes.
isoscope::internal::v1::GetDepthBoundsResponse ToProto(const visibility::DepthBounds& bounds);

// Safe for any bytes: memory depends on `size` alone. DATA_LOSS if the planes are damaged, or not
// of this size; INVALID_ARGUMENT if two values can't be bounds.
absl::StatusOr<visibility::DepthBounds> DepthBoundsFromProto(
    const isoscope::internal::v1::GetDepthBoundsResponse& proto, const view::Viewport& size);

}  // namespace isoscope::wire

#endif  // ISOSCOPE_WIRE_DEPTH_BOUNDS_CONVERT_H_
