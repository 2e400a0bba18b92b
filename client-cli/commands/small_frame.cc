#include "client-cli/commands/small_frame.h"

#include <algorithm>
#include <cstdint>

namespace isoscope::cli {

isoscope::v1::RenderIsosurfaceRequest SmallFrameOf(
    const isoscope::v1::RenderIsosurfaceRequest& frame, int side_px) {
  isoscope::v1::RenderIsosurfaceRequest small = frame;
  small.clear_region();
  small.clear_output();
  small.clear_samples();
  isoscope::v1::Viewport& viewport = *small.mutable_viewport();
  const int side = std::max(viewport.width_px(), viewport.height_px());
  if (side > side_px) {
    const auto scaled = [&](int px) {
      return std::max(static_cast<int>(std::int64_t{px} * side_px / side), 1);
    };
    viewport.set_width_px(scaled(viewport.width_px()));
    viewport.set_height_px(scaled(viewport.height_px()));
  }
  return small;
}

}  // namespace isoscope::cli
