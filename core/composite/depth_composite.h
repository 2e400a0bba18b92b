// Sort-last compositing: the reduce of steps 2 and 3.

#ifndef ISOSCOPE_CORE_COMPOSITE_DEPTH_COMPOSITE_H_
#define ISOSCOPE_CORE_COMPOSITE_DEPTH_COMPOSITE_H_

#include "core/image/frame_image.h"
#include "core/image/layer_stack.h"

namespace isoscope::composite {

// Keeps the first fragment in `order` of each pixel of `from` and `into`, in `into`. Associative,
// commutative and idempotent: the order of arrival and the number of agents do not matter.
// O(pixels of the tiles touched in `from`). REQUIRES: both images have the same size.
void CompositeInto(const image::FrameImage& from, const image::FragmentOrder& order,
                   image::FrameImage* into);

// The same for one row of tiles. Threads may composite different rows at a time, of one image or of
// several.
void CompositeTileRowInto(const image::FrameImage& from, int tile_row,
                          const image::FragmentOrder& order, image::FrameImage* into);
// Inserts the fragments of a row of tiles of all images of `from` into `into`. Threads as above.
void CompositeTileRowInto(const image::LayerStack& from, int tile_row, image::LayerStack* into);

// Lays `image` over the background colour (straight alpha), in place. image->colors is then the
// final picture, and all pixels count as covered. Does nothing if the background is transparent
// black. Works in parallel, inside the caller's TBB arena.
void FlattenOver(image::Rgba8 background, image::FrameImage* image);

}  // namespace isoscope::composite

#endif  // ISOSCOPE_CORE_COMPOSITE_DEPTH_COMPOSITE_H_
