// Blends the translucent layers and the opaque image of a frame to one picture.

#ifndef ISOSCOPE_CORE_PICTURE_LAYER_BLENDING_H_
#define ISOSCOPE_CORE_PICTURE_LAYER_BLENDING_H_

#include <cstdint>

#include "core/frame/frame_spec.h"
#include "core/image/frame_image.h"
#include "core/image/layer_stack.h"
#include "core/view/view.h"

namespace isoscope::picture {

// Lays the layers over the image and the spec's background, in place: of each pixel the first
// spec.max_layers that lie before its opaque fragment, nearest first, in linear light, with the
// opacities of their surfaces. If a surface's map has opacities, the alpha of a layer's colour is
// the step of the map (deferred_shading.h). Colours are then final where layers show; keys do not
// change. Returns the number of pixels where more layers than that would show, among those of
// `counted`, in pixels of the image.
//
// Works in parallel, in the tbb::task_arena of the caller. O(pixels with layers).
// REQUIRES: layers and image have the same size.
std::int64_t BlendLayers(const image::LayerStack& layers, const frame::FrameSpec& spec,
                         const view::PixelRect& counted, image::FrameImage* image);
// The same; counts in the whole image.
std::int64_t BlendLayers(const image::LayerStack& layers, const frame::FrameSpec& spec,
                         image::FrameImage* image);

// Replaces key and colour of each pixel by those of its first layer, where that lies before the
// opaque fragment: planes and picks report the nearest fragment, however translucent.
void ShowNearest(const image::LayerStack& layers, image::FrameImage* image);
// The same for keys alone: colours stay.
void ShowNearestKeys(const image::LayerStack& layers, image::FrameImage* image);

}  // namespace isoscope::picture

#endif  // ISOSCOPE_CORE_PICTURE_LAYER_BLENDING_H_
