// A frame as it was asked for, in core types: what rpc::FrameSpecFromProto makes of a request, and
// what coordinator and agents derive everything else from. A new parameter of a frame becomes a
// member here.

#ifndef ISOSCOPE_CORE_FRAME_FRAME_SPEC_H_
#define ISOSCOPE_CORE_FRAME_FRAME_SPEC_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "absl/status/status.h"

#include "core/frame/appearance.h"
#include "core/frame/culling.h"
#include "core/image/fragment.h"
#include "core/view/camera.h"

namespace isoscope::frame {

// One isosurface of a frame.
struct Surface {
  double isovalue = 0;  // finite
  Appearance appearance;

  friend bool operator==(const Surface&, const Surface&) = default;
};

inline constexpr std::size_t kMaxSurfaces = 16;

struct FrameSpec {
  // 1 to kMaxSurfaces. Of fragments of equal depth the earlier surface's shows.
  std::vector<Surface> surfaces;
  // None: the default camera of the dataset. The coordinator resolves it before agents see it.
  std::optional<view::Camera> camera;
  view::Viewport viewport;
  Culling culling = Culling::kDepth;
  image::Rgba8 background_color{0, 0, 0, 255};
  std::uint64_t ray_seed = 0;

  friend bool operator==(const FrameSpec&, const FrameSpec&) = default;
};

// The isovalues of its surfaces, in their order.
std::vector<double> IsovaluesOf(const FrameSpec& spec);

// INVALID_ARGUMENT if `surface_count` surfaces of a volume of `block_count` blocks have more owners
// of fragments than there are numbers for (image::FragmentOrder).
absl::Status CheckOwners(std::size_t surface_count, std::int64_t block_count);

}  // namespace isoscope::frame

#endif  // ISOSCOPE_CORE_FRAME_FRAME_SPEC_H_
