// From the drawn pixels of a frame to its picture: the stages between compositing and encoding. No
// gRPC types.

#ifndef ISOSCOPE_SERVER_PICTURE_PICTURE_FINISH_H_
#define ISOSCOPE_SERVER_PICTURE_PICTURE_FINISH_H_

#include <cstdint>

#include "core/frame/drawn_window.h"
#include "core/frame/frame_spec.h"
#include "core/image/fragment.h"
#include "core/image/frame_image.h"
#include "core/image/layer_stack.h"
#include "core/picture/picture_contents.h"
#include "core/view/view.h"

namespace isoscope::server {

// All objects that it points to outlive the call.
struct PictureSetup {
  const frame::FrameSpec* spec = nullptr;      // as in the client's request
  const frame::DrawnWindow* window = nullptr;  // the spec's
  const view::View* drawn_view = nullptr;      // of the window
  image::FragmentOrder order;
  image::LayerStack* layers = nullptr;  // layers of the drawn image
  image::FrameImagePool* images = nullptr;
  bool finds_shown_surfaces = false;
};

struct FinishedPicture {
  image::FrameImage image;
  // Drawn pixels that have more translucent layers than the spec allows, without those of a margin.
  std::int64_t truncated_pixel_count = 0;
  // The contents of the picture, without its margin. `shown` is empty unless it was asked for.
  picture::PictureContents contents;
};

// Finishes the drawn image: a picture of the spec's size, to be encoded over the background. If the
// frame has planes, depths and owners are those of the nearest fragment of each pixel, however
// translucent. Else they are those of the opaque fragments. With several samples the picture has
// neither. Each stage computes a pixel from composited pixels of the whole viewport alone, so the
// result does not depend on agents, tiles or regions.
//
// Works in parallel, in the tbb::task_arena of the caller. Changes `drawn` and the layers, and
// takes `drawn` if it is the picture. REQUIRES: `drawn` has the window's size; it and the layers
// carry normals if picture::NeedsDeferredShading, else colours. Throws std::bad_alloc if memory
// runs out.
FinishedPicture FinishPicture(const PictureSetup& setup, image::FrameImage* drawn);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_PICTURE_PICTURE_FINISH_H_
