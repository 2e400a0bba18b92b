// Sort-last compositing: the reduce of steps 2 and 3.

#ifndef ISOSCOPE_CORE_COMPOSITE_DEPTH_COMPOSITE_H_
#define ISOSCOPE_CORE_COMPOSITE_DEPTH_COMPOSITE_H_

#include "core/image/frame_image.h"

namespace isoscope::composite {

// Keeps, in each pixel of `into`, the fragment that comes first in `order`. Associative,
// commutative and idempotent: the order of arrival and the number of agents do not matter.
// O(pixels of the tiles touched in `from`). REQUIRES: same size.
void CompositeInto(const image::FrameImage& from, const image::FragmentOrder& order,
                   image::FrameImage* into);

// Makes `image` the final picture, over the background colour (straight alpha), in place:
// image->colors is then what to show. All pixels count as covered, unless the background is
// transparent black and there is nothing to do. In parallel, inside the caller's TBB arena.
void FlattenOver(image::Rgba8 background, image::FrameImage* image);

}  // namespace isoscope::composite

#endif  // ISOSCOPE_CORE_COMPOSITE_DEPTH_COMPOSITE_H_
