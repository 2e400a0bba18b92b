#include "core/image/frame_image.h"

#include "core/base/check.h"

namespace isoscope::image {

FrameImage::FrameImage(int image_width, int image_height)
    : width(image_width), height(image_height) {
  ISOSCOPE_CHECK_GE(width, 0);
  ISOSCOPE_CHECK_GE(height, 0);
  depth.assign(pixel_count(), kFarDepth);
  block_id.assign(pixel_count(), kNoBlock);
  color.assign(pixel_count(), Rgba8{});
}

}  // namespace isoscope::image
