// Lines where a surface ends: in front of the background, of another surface, or of a part of
// itself that lies much farther. They use depths and owners alone, after compositing.

#ifndef ISOSCOPE_CORE_PICTURE_SILHOUETTE_H_
#define ISOSCOPE_CORE_PICTURE_SILHOUETTE_H_

#include "core/frame/picture_effects.h"
#include "core/image/fragment.h"
#include "core/image/frame_image.h"
#include "core/view/view.h"

namespace isoscope::picture {

// Draws lines into the colours of `image`. A line lies on the nearer side, inside the surface that
// ends, so that no background gets covered.
//
// view:             of the image
// samples_per_side: pixels of the image to a pixel of the final picture, on each axis, whose pixels
//                   the width counts
//
// A pixel depends on pixels that are at most width + Silhouette::kBorderPx pixels of the final
// picture away. The border of the viewport is no edge. Works in parallel, in the tbb::task_arena of
// the caller; the picture does not depend on threads.
void DrawSilhouettes(const frame::Silhouette& silhouette, const view::View& view,
                     const image::FragmentOrder& order, int samples_per_side,
                     image::FrameImage* image);

}  // namespace isoscope::picture

#endif  // ISOSCOPE_CORE_PICTURE_SILHOUETTE_H_
