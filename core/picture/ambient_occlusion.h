// Screen-space ambient occlusion: hollows get less light. It uses depths alone, after compositing.

#ifndef ISOSCOPE_CORE_PICTURE_AMBIENT_OCCLUSION_H_
#define ISOSCOPE_CORE_PICTURE_AMBIENT_OCCLUSION_H_

#include "core/frame/picture_effects.h"
#include "core/image/frame_image.h"
#include "core/view/view.h"

namespace isoscope::picture {

// Darkens the colours of `image` in linear light.
//
// view:             of the image
// samples_per_side: pixels of the image to a pixel of the final picture, on each axis, whose pixels
//                   the radius counts
//
// A pixel depends on its position in the whole viewport, and on the depths of pixels at most radius
// + AmbientOcclusion::kBorderPx pixels of the final picture away; pixels outside that are
// background. Takes 5 bytes for each pixel of the image. Works in parallel, in the tbb::task_arena
// of the caller; the picture depends neither on threads nor on instruction sets.
void ShadeAmbientOcclusion(const frame::AmbientOcclusion& occlusion, const view::View& view,
                           int samples_per_side, image::FrameImage* image);

}  // namespace isoscope::picture

#endif  // ISOSCOPE_CORE_PICTURE_AMBIENT_OCCLUSION_H_
