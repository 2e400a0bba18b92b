// Finds the surfaces and values that the pixels of a frame show: for legends, and for notes on
// surfaces.

#ifndef ISOSCOPE_CORE_PICTURE_PICTURE_CONTENTS_H_
#define ISOSCOPE_CORE_PICTURE_PICTURE_CONTENTS_H_

#include <bitset>

#include "core/frame/frame_spec.h"
#include "core/image/fragment.h"
#include "core/image/frame_image.h"
#include "core/image/layer_stack.h"
#include "core/picture/deferred_shading.h"
#include "core/view/view.h"

namespace isoscope::picture {

// A fragment shows if it is the opaque one of its pixel, or one of the first spec.max_layers before
// it, and if its opacity is above 0 and no nearer fragment is opaque.
struct PictureContents {
  // By surface: whether a fragment of it shows, also one of its caps.
  std::bitset<frame::kMaxSurfaces> shown;
  // By surface: whether a fragment shows whose value is missing (NaN), so that it has no colour of
  // the map.
  std::bitset<frame::kMaxSurfaces> without_values;
  // Whether a cap with a colour map shows a place without a sample.
  bool has_caps_without_samples = false;

  friend bool operator==(const PictureContents&, const PictureContents&) = default;
};

// The composited fragments of a frame, as agents sent them: before DeferredShader and BlendLayers.
// All objects that it points to outlive the calls.
struct DrawnFragments {
  const frame::FrameSpec* spec = nullptr;
  image::FragmentOrder order;
  const image::FrameImage* image = nullptr;
  const image::LayerStack* layers = nullptr;
  // Null unless the fragments carry normals for a picture. Opacities of maps then do not count.
  const DeferredShader* shader = nullptr;
};

// Returns what shows in `window`, in pixels of the image. Without `with_shown` no bit of `shown` is
// set, and the cost is small where no value is missing.
//
// Works in parallel, in the tbb::task_arena of the caller. O(drawn pixels).
// REQUIRES: at most kMaxSurfaces surfaces.
PictureContents FindContents(const DrawnFragments& drawn, const view::PixelRect& window,
                             bool with_shown);

// Gives caps without a sample (kNoSample) the colour of missing values, where no DeferredShader
// does. Works in parallel, as FindContents.
void ColorCapsWithoutSamples(const frame::FrameSpec& spec, image::FrameImage* image);

}  // namespace isoscope::picture

#endif  // ISOSCOPE_CORE_PICTURE_PICTURE_CONTENTS_H_
