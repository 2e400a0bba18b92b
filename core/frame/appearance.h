// The look of a surface, and the lights on it.

#ifndef ISOSCOPE_CORE_FRAME_APPEARANCE_H_
#define ISOSCOPE_CORE_FRAME_APPEARANCE_H_

#include <cstddef>
#include <optional>
#include <string>

#include "core/image/fragment.h"
#include "core/math/vec.h"

namespace isoscope::frame {

// A directional light.
struct Light {
  // In kView, x points to the right of the picture, y up, and z to the eye.
  enum class Space { kView, kWorld };

  math::Vec3d direction{0, 0, 1};  // from the scene to the light; a length neither 0 nor infinite
  Space space = Space::kView;
  float intensity = 1;  // [0, kMaxLightIntensity]
  image::Rgba8 color{255, 255, 255, 255};

  friend bool operator==(const Light&, const Light&) = default;
};

inline constexpr std::size_t kMaxLights = 4;
inline constexpr float kMaxLightIntensity = 10;

enum class ColorMap { kViridis, kMagma, kCividis, kTurbo, kCoolWarm, kGrey };

// Returns the colour of missing values (NaN), unless a frame has its own: grey, or purple beside a
// map that has this grey.
constexpr image::Rgba8 DefaultNanColor(ColorMap map) {
  return map == ColorMap::kGrey || map == ColorMap::kCividis ? image::Rgba8{128, 0, 128, 255}
                                                             : image::Rgba8{128, 128, 128, 255};
}

// min < max, both finite.
struct ColorRange {
  double min = 0;
  double max = 1;

  friend bool operator==(const ColorRange&, const ColorRange&) = default;
};

// Returns the range of a map over samples in [min, max], which may be one value. REQUIRES: both are
// finite.
ColorRange ColorRangeOfSamples(double min, double max);

// The values that a range without numbers is of. The coordinator finds the numbers before agents get
// the frame.
enum class RangeSource {
  kAllSteps,  // samples of all time steps, the bound of all gradients, the volume's box
  kStep,      // the same at the time step that is drawn
  kVisible,   // values that the picture shows
};

// A range of sample values by shares of the samples, in percent: 0 <= low < high <= 100.
struct Percentiles {
  double low = 2;
  double high = 98;

  friend bool operator==(const Percentiles&, const Percentiles&) = default;
};

// The quantity that the colour of a surface shows, in place of its base colour.
struct ColorBy {
  enum class Quantity {
    kPositionX,
    kPositionY,
    kPositionZ,
    kNormal,
    kGradientMagnitude,
    kField,  // samples of another scalar volume of the same grid
  };

  Quantity quantity = Quantity::kPositionX;
  ColorMap map = ColorMap::kViridis;  // not of kNormal
  // Not of kNormal. Not set: that of `range_source`.
  std::optional<ColorRange> range = std::nullopt;
  // Opacities at the ends of the map, in [0, 1]; ignored for kNormal.
  float opacity_at_min = 1;
  float opacity_at_max = 1;
  // For kField alone. Only the coordinator reads them.
  std::string field = {};
  std::string component = {};  // empty: the only one, or the magnitude
  RangeSource range_source = RangeSource::kAllSteps;

  [[nodiscard]] bool is_translucent() const { return opacity_at_min < 1 || opacity_at_max < 1; }

  friend bool operator==(const ColorBy&, const ColorBy&) = default;
};

// How the cuts of a clip region through the inside of opaque surfaces are filled.
struct ClipCaps {
  std::optional<ColorMap> map = std::nullopt;  // not set: the look of the surface
  // Not set: that of `percentiles`, or of `range_source`, of the drawn field's finite samples.
  std::optional<ColorRange> range = std::nullopt;
  RangeSource range_source = RangeSource::kAllSteps;
  std::optional<Percentiles> percentiles = std::nullopt;  // only with kAllSteps

  friend bool operator==(const ClipCaps&, const ClipCaps&) = default;
};

// Two-sided smooth shading under a head light: with c = |n . v| (n the unit normal, v the unit
// direction to the eye), colour = base * (ambient + diffuse * c) + specular * c^shininess, in sRGB
// values, clamped. core/picture/deferred_shading.h has the same with other lights.
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
