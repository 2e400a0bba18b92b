// From the value that a surface shows, the length of the gradient or a sample of a field, to a step
// of its colour map. Steps are made here, where the value is known, and coloured where the light is
// computed (core/picture/deferred_shading.h).

#ifndef ISOSCOPE_CORE_RENDER_MAP_LEVEL_H_
#define ISOSCOPE_CORE_RENDER_MAP_LEVEL_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "core/frame/frame_spec.h"

namespace isoscope::render {

// Levels are linear in the value: 0 at the least value of the range, kMapSteps at the greatest.
inline constexpr int kMapSteps = 256;

class MapScale {
 public:
  explicit MapScale(const frame::ColorRange& range)
      : min_(range.min), length_(range.max - range.min) {}

  // Finite, for any value: that of NaN lies far beyond the greatest end, so that it shows in every
  // triangle that has it.
  [[nodiscard]] float LevelOf(double value) const {
    const double level = (value - min_) / length_ * kMapSteps;
    // False for NaN.
    return static_cast<float>(level < kMostLevel ? std::max(level, -kMostLevel) : kMostLevel);
  }

 private:
  static constexpr double kMostLevel = 1e30;

  double min_;
  double length_;
};

// Returns the step of a level. All steps have the same length; levels outside the range get the
// nearest end's step.
inline std::uint8_t MapStepOf(float level) {
  // False for NaN.
  return level > 0 ? static_cast<std::uint8_t>(std::min(level, kMapSteps - 1.0F)) : std::uint8_t{0};
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
