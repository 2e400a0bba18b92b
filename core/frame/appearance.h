// The look of a surface.

#ifndef ISOSCOPE_CORE_FRAME_APPEARANCE_H_
#define ISOSCOPE_CORE_FRAME_APPEARANCE_H_

#include <optional>

#include "core/image/fragment.h"

namespace isoscope::frame {

// Two-sided smooth shading under a head light: with c = |n . v| (n the unit normal, v the unit
// direction to the eye), colour = base * (ambient + diffuse * c) + specular * c^shininess, in sRGB
// values, clamped.
struct Appearance {
  image::Rgba8 base_color{222, 209, 190, 255};
  float ambient = 0.12F;
  std::optional<float> diffuse = std::nullopt;  // not set: 1 - ambient
  float specular = 0.22F;
  float shininess = 32.0F;

  friend bool operator==(const Appearance&, const Appearance&) = default;
};

}  // namespace isoscope::frame

#endif  // ISOSCOPE_CORE_FRAME_APPEARANCE_H_
