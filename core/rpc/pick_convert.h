// Converts a pick between wire and core types: the smallest frame that holds its pixels.

#ifndef ISOSCOPE_CORE_RPC_PICK_CONVERT_H_
#define ISOSCOPE_CORE_RPC_PICK_CONVERT_H_

#include <vector>

#include "absl/status/statusor.h"

#include "core/frame/frame_spec.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::rpc {

// A pixel of the whole viewport.
struct PixelPosition {
  int x = 0;
  int y = 0;

  friend bool operator==(const PixelPosition&, const PixelPosition&) = default;
};

inline constexpr int kMaxPickedPixels = 1000;

struct PickSpec {
  // The frame of the request, with the region around all pixels and exact culling.
  isoscope::v1::RenderIsosurfaceRequest request;
  frame::FrameSpec frame;             // the same, converted; has a region
  std::vector<PixelPosition> pixels;  // 1 to kMaxPickedPixels, all in the region
};

// Checks everything that does not depend on the dataset, also for unknown fields. INVALID_ARGUMENT
// names the field, its value and the allowed values.
absl::StatusOr<PickSpec> PickSpecFromProto(const isoscope::v1::PickSurfaceRequest& proto);

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_CORE_RPC_PICK_CONVERT_H_
