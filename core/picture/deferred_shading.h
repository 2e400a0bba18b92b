// Computes the colours of fragments that agents send as normals: for frames with directional
// lights, and for surfaces whose colour shows a quantity.
//
// A colour follows from the fragment's pixel, depth bits, surface and encoded normal alone, so it
// depends neither on agents nor on blocks nor on regions (docs/numerics.md, "Lights and colours").
//
// The formula, in sRGB values as the head light's (frame::Appearance), clamped:
//
//   colour = base * (ambient + diffuse * D) + specular * S
//
// base is the surface's colour, or the colour from its color_by. v is the unit direction from the
// point to the eye. n is the unit normal, turned to the side that is seen: n . v >= 0. Without a
// normal n is v. D and S are sums over the lights, of intensity * colour of the light *
//
//   d                  for D, with d = max(n . l, 0), l the unit direction to the light
//   (n . h)^shininess  for S where d > 0, with h = (l + v) / |l + v|
//
// Without lights there is the head light, l = v: D = n . v, S = (n . v)^shininess. A light along
// the view axis gives the same with an orthographic camera. With a perspective one it does not turn
// with the ray of each pixel, as the head light does.

#ifndef ISOSCOPE_CORE_PICTURE_DEFERRED_SHADING_H_
#define ISOSCOPE_CORE_PICTURE_DEFERRED_SHADING_H_

#include <cstdint>
#include <span>
#include <vector>

#include "core/frame/frame_spec.h"
#include "core/image/fragment.h"
#include "core/image/frame_image.h"
#include "core/picture/color_map.h"
#include "core/picture/light_kernel.h"
#include "core/view/unprojection.h"
#include "core/view/view.h"

namespace isoscope::picture {

// Whether the frame's colours are computed from normals (frame::FrameSpec::sends_normals).
bool NeedsDeferredShading(const frame::FrameSpec& spec);

// A fragment at pixel (x, y) of the picture. The key is not the background's.
struct NormalFragment {
  int x = 0;
  int y = 0;
  std::uint64_t key = 0;
  // image::EncodeNormal; of a surface that shows values, image::EncodeNormalAndStep, or
  // image::EncodeNormalWithoutStep where the value is missing.
  image::Rgba8 normal;
};

// Immutable; thread-safe. All instruction sets give the same bits.
class DeferredShader {
 public:
  // spec:  its surfaces and lights
  // view:  the view that the fragments were drawn with
  // order: of the fragments' owners
  DeferredShader(const frame::FrameSpec& spec, const view::View& view,
                 const image::FragmentOrder& order);

  // Sets colors[i] to the colour of fragments[i], with the alpha of its surface's base colour; or,
  // if the surface's map has opacities, with the step of the map as alpha, which BlendLayers knows.
  // A colour does not depend on the other fragments. REQUIRES: as many colours as fragments, and
  // surfaces of the spec.
  void Shade(std::span<const NormalFragment> fragments, std::span<image::Rgba8> colors) const;

  // Turns the normals of all covered pixels into colours. Caps that show samples have theirs, and
  // get the owner of their surface; picture::kNoSample becomes the colour of missing values. Works
  // in parallel, in the tbb::task_arena of the caller.
  void ShadeImage(image::FrameImage* image) const;

  // Returns the step of its surface's map that a fragment's opacity has. REQUIRES: it has a map.
  [[nodiscard]] std::size_t OpacityStepOf(const NormalFragment& fragment) const;

 private:
  // How a surface gets its base colour.
  struct BaseColor {
    image::Rgba8 color;
    const ColorMapTable* map = nullptr;  // null: the colour, or that of the normal
    image::Rgba8 nan_color;              // where the value is missing
    std::uint8_t step_of_nan = 0;
    frame::ColorRange range;
    int axis = 0;
    bool has_step = false;    // fragments carry the step of the map
    bool keeps_step = false;  // the step of the map is the alpha
  };

  [[nodiscard]] std::size_t StepOf(const BaseColor& base, const NormalFragment& fragment) const;
  [[nodiscard]] image::Rgba8 BaseOf(const BaseColor& base, const NormalFragment& fragment) const;
  void Append(const NormalFragment& fragment, LightBatch* batch) const;
  // Gives the owner of a cap that shows samples the number of its surface
  // (frame::OwnerSurfaceCount). Returns false if the key is of another fragment.
  bool TakeSampleCap(std::uint64_t* key) const;
  void ShadeTileRow(int row, image::FrameImage* image) const;

  const image::FragmentOrder order_;
  const view::Unprojection unprojection_;
  const float first_x_;  // the centre of the picture's first pixel, in pixels of the whole
  const float first_y_;
  const view::LinearVec3f rays_;  // directions
  const bool has_sample_caps_;
  const image::Rgba8 nan_color_of_caps_;
  std::vector<LightTerm> lights_;
  MaterialTerms materials_;
  std::vector<BaseColor> bases_;  // by surface
};

}  // namespace isoscope::picture

#endif  // ISOSCOPE_CORE_PICTURE_DEFERRED_SHADING_H_
