// From the drawn pixels of a frame to its picture: the stages between compositing and encoding. No
// gRPC types.

#ifndef ISOSCOPE_SERVER_PICTURE_FINISH_H_
#define ISOSCOPE_SERVER_PICTURE_FINISH_H_

#include "core/frame/drawn_window.h"
#include "core/frame/frame_spec.h"
#include "core/image/fragment.h"
#include "core/image/frame_image.h"
#include "core/view/view.h"

namespace isoscope::server {

// All objects that it points to outlive the call.
struct PictureSetup {
  const frame::FrameSpec* spec = nullptr;      // as the client asked for it
  const frame::DrawnWindow* window = nullptr;  // the spec's
  const view::View* drawn_view = nullptr;      // of the window
  image::FragmentOrder order;
  image::FrameImagePool* images = nullptr;
};

// Makes the picture of what was drawn: of the spec's size, to be encoded over the background.
// Depths and owners stay those of the pixels, unless the frame has several samples: then the
// picture has none. Each stage computes a pixel from composited pixels of the whole viewport alone,
// so neither agents, tiles nor regions can show.
//
// Works in parallel, in the tbb::task_arena of the caller. Changes `drawn`, and takes it if it is
// the picture. REQUIRES: `drawn` carries colours, and has the window's size.
image::FrameImage FinishPicture(const PictureSetup& setup, image::FrameImage* drawn);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_PICTURE_FINISH_H_
