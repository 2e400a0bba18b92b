// A coarse grid of a picture's depths. With it a client warps the picture to a newer camera, until
// the next frame arrives. No gRPC types.

#ifndef ISOSCOPE_SERVER_PICTURE_DEPTH_GRID_H_
#define ISOSCOPE_SERVER_PICTURE_DEPTH_GRID_H_

#include <cstdint>
#include <string>
#include <vector>

#include "core/image/frame_image.h"
#include "core/view/camera.h"
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

// Makes the grid of a picture that is drawn in bands, or at once. Thread-compatible.
class DepthGridBuilder {
 public:
  // The grid has width x height points, so that the longer side has `longer_side` points, or as
  // many as the picture has pixels. REQUIRES: longer_side >= 1.
  DepthGridBuilder(const view::Viewport& picture, int longer_side);

  // Takes the points that lie in the band of the picture that `image` shows from its pixel
  // (margin_x, margin_y) on. O(points). REQUIRES: `view` is that of the image.
  //
  // band: in pixels of the picture
  void Add(const view::Region& band, const image::FrameImage& image, const view::View& view,
           int margin_x, int margin_y);
  // REQUIRES: all bands were added.
  [[nodiscard]] DepthGrid Make() const;

 private:
  const view::Viewport picture_;
  int width_ = 0;
  int height_ = 0;
  std::vector<float> distances_;  // row by row; infinite: background
};

// Returns the grid of a picture that is drawn at once.
DepthGrid MakeDepthGrid(const image::FrameImage& image, const view::View& view, int longer_side);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_PICTURE_DEPTH_GRID_H_
