// Sort-last compositing: the reduce of steps 2 and 3.

#ifndef ISOSCOPE_CORE_COMPOSITE_DEPTH_COMPOSITE_H_
#define ISOSCOPE_CORE_COMPOSITE_DEPTH_COMPOSITE_H_

#include <cstdint>
#include <vector>

#include "core/image/frame_image.h"

namespace isoscope::composite {

// Keeps, in each pixel of `into`, the fragment with the smaller FragmentKey. Associative,
// commutative and idempotent: the order of arrival and the number of agents do not matter.
// REQUIRES: same size.
void CompositeInto(const image::FrameImage& from, image::FrameImage* into);

// The final picture: `image` over the background colour (straight alpha).
std::vector<image::Rgba8> FlattenOver(const image::FrameImage& image, image::Rgba8 background);

}  // namespace isoscope::composite

#endif  // ISOSCOPE_CORE_COMPOSITE_DEPTH_COMPOSITE_H_
