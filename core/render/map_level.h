// From the value that a surface shows, the length of the gradient or a sample of a field, to a step
// of its colour map. Steps are made here, where the value is known, and coloured where the light is
// computed (core/picture/deferred_shading.h).

#ifndef ISOSCOPE_CORE_RENDER_MAP_LEVEL_H_
#define ISOSCOPE_CORE_RENDER_MAP_LEVEL_H_

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "core/frame/frame_spec.h"
#include "core/image/fragment.h"
#include "core/image/normal_and_step.h"

namespace isoscope::render {

// Map levels are linear in the value: 0 at the range's least value, kMapSteps at the greatest.
inline constexpr int kMapSteps = 256;

class MapScale {
 public:
  explicit MapScale(const frame::ColorRange& range)
      : min_(range.min), length_(range.max - range.min) {}

  // NaN for NaN, else finite: infinite values have the largest level, with their sign.
  [[nodiscard]] float MapLevelOf(double value) const {
    const double level = (value - min_) / length_ * kMapSteps;
    // Comparisons are false for NaN.
    return static_cast<float>(level > kLargestMapLevel    ? kLargestMapLevel
                              : level < -kLargestMapLevel ? -kLargestMapLevel
                                                          : level);
  }

  static constexpr double kLargestMapLevel = 1e30;

 private:
  double min_;
  double length_;
};

// Returns the map levels of a triangle's corners as they are mixed: finite ones as they are. Else
// all three are alike, so that no weight can show: NaN if one is NaN or if they have both ends of
// infinite values, else that end.
inline std::array<float, 3> MapLevelsToMix(const std::array<float, 3>& levels) {
  constexpr auto kLargest = static_cast<float>(MapScale::kLargestMapLevel);
  float end = 0;
  for (const float level : levels) {
    // False for NaN.
    if (!(std::abs(level) < kLargest)) {
      // NaN stays, and infinities of both signs add up to it.
      end += level * std::numeric_limits<float>::infinity();
    }
  }
  if (end == 0) {
    return levels;
  }
  end = std::isnan(end) ? end : std::copysign(kLargest, end);
  return {end, end, end};
}

// Returns the step of a map level. All steps have the same length; levels outside the range get the
// nearest end's step. REQUIRES: the level is not NaN.
inline std::uint8_t MapStepOf(float level) {
  return level > 0 ? static_cast<std::uint8_t>(std::min(level, kMapSteps - 1.0F)) : std::uint8_t{0};
}

// Returns the colour of a fragment of a surface that shows values: image::EncodeNormal of its
// normal, with the step of its level. Without one where the level is NaN.
inline image::Rgba8 CodeOf(image::Rgba8 normal, float level) {
  return std::isnan(level) ? image::EncodeNormalWithoutStep(normal)
                           : image::EncodeNormalAndStep(normal, MapStepOf(level));
}

// By surface; none where fragments carry no step. REQUIRES: of a frame that sends map steps,
// surfaces that show values have a range.
inline std::vector<std::optional<MapScale>> MapScalesOf(const frame::FrameSpec& spec) {
  std::vector<std::optional<MapScale>> scales(spec.surfaces.size());
  for (std::size_t i = 0; i < scales.size(); ++i) {
    if (spec.sends_map_steps && spec.surfaces[i].shows_values()) {
      scales[i].emplace(spec.surfaces[i].color_by->range.value());
    }
  }
  return scales;
}

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_MAP_LEVEL_H_
