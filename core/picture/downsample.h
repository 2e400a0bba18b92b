// The picture of a frame that was drawn with several samples a pixel, or with a margin.

#ifndef ISOSCOPE_CORE_PICTURE_DOWNSAMPLE_H_
#define ISOSCOPE_CORE_PICTURE_DOWNSAMPLE_H_

#include "core/image/fragment.h"
#include "core/image/frame_image.h"

namespace isoscope::picture {

// Where a picture lies in the pixels that were drawn for it.
struct SampleGrid {
  int samples_per_side = 1;  // drawn pixels of a pixel, on each axis
  // The first drawn pixel of the picture.
  int begin_x = 0;
  int begin_y = 0;
};

// Makes each pixel of `picture` the mean of its samples, in linear light: the mean of alpha, and of
// colours weighted by their alpha. Samples whose alpha is 0 show `background`; others are final,
// whatever their alpha. A pixel without a sample on a surface stays as it is: all background.
//
// colours: sRGB, straight alpha; those of `drawn` as image::FrameImage says
// keys:    those of `picture` stay background, because a mean has no depth
//
// Works in parallel, in the tbb::task_arena of the caller; the picture does not depend on the
// number of threads. REQUIRES: `picture` is all background; its samples lie inside `drawn`; 1 <=
// samples_per_side <= 4.
void Downsample(const image::FrameImage& drawn, const SampleGrid& grid, image::Rgba8 background,
                image::FrameImage* picture);

// Makes `picture` the window of `drawn` that begins at `begin_x`, `begin_y`: colours and keys.
// REQUIRES: `picture` is all background, and the window lies inside `drawn`.
void Crop(const image::FrameImage& drawn, int begin_x, int begin_y, image::FrameImage* picture);

}  // namespace isoscope::picture

#endif  // ISOSCOPE_CORE_PICTURE_DOWNSAMPLE_H_
