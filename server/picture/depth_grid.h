// A coarse grid of a picture's depths. With it a client warps the picture to a newer camera, until
// the next frame arrives. No gRPC types.

#ifndef ISOSCOPE_SERVER_PICTURE_DEPTH_GRID_H_
#define ISOSCOPE_SERVER_PICTURE_DEPTH_GRID_H_

#include <cstdint>
#include <string>

#include "core/image/frame_image.h"
#include "core/view/view.h"

namespace isoscope::server {

// A grid of depths, as isoscope.v1.DepthGrid describes it.
struct DepthGrid {
  int width = 0;
  int height = 0;
  double near_distance = 0;
  double far_distance = 0;
  std::string depths = {};
};

inline constexpr std::uint16_t kGridBackground = 65535;

// Returns the depths at width x height points, so that the longer side has `longer_side` points, or
// as many as the picture has pixels. O(points). REQUIRES: `view` is that of the image, and
// longer_side >= 1.
DepthGrid MakeDepthGrid(const image::FrameImage& image, const view::View& view, int longer_side);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_PICTURE_DEPTH_GRID_H_
