// Colour maps: from a value to a colour.

#ifndef ISOSCOPE_CORE_PICTURE_COLOR_MAP_H_
#define ISOSCOPE_CORE_PICTURE_COLOR_MAP_H_

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "core/frame/appearance.h"
#include "core/image/fragment.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::picture {

// Opaque colours, from the least value to the greatest.
inline constexpr std::size_t kColorMapSteps = 256;
using ColorMapTable = std::array<image::Rgba8, kColorMapSteps>;

// Stands for the colour of a cap where its sample is missing (NaN). The coordinator knows the true
// one. No map has it, because the colours of maps are opaque.
inline constexpr image::Rgba8 kNoSample{0, 0, 0, 0};

// Returns the colours of a map, the same on every machine. Thread-safe.
const ColorMapTable& ColorMapTableOf(frame::ColorMap map);

// Returns the step of a value: the range is cut into kColorMapSteps parts of one length; values
// outside have the step of the nearest end. REQUIRES: value is not NaN.
inline std::size_t ColorMapStepOf(double value, const frame::ColorRange& range) {
  const double share = (value - range.min) / (range.max - range.min);
  return static_cast<std::size_t>(
      std::clamp(share * kColorMapSteps, 0.0, static_cast<double>(kColorMapSteps - 1)));
}

// Returns the opacity of a step: linear from the first to the last. That of all steps is 1 where
// the map has none.
inline float OpacityOf(const frame::ColorBy& color_by, std::size_t step) {
  if (step == kColorMapSteps - 1) {
    return color_by.opacity_at_max;  // exact, in spite of rounding
  }
  const float share = static_cast<float>(step) / static_cast<float>(kColorMapSteps - 1);
  return color_by.opacity_at_min + (color_by.opacity_at_max - color_by.opacity_at_min) * share;
}

// Returns the step whose opacity missing values (NaN) have: that of the more opaque end, so that
// they are never fainter than all that has a value.
inline std::uint8_t StepOfNan(const frame::ColorBy& color_by) {
  return color_by.opacity_at_min > color_by.opacity_at_max
             ? std::uint8_t{0}
             : static_cast<std::uint8_t>(kColorMapSteps - 1);
}

// Returns the range that a surface is coloured by: its own, or the volume's box on the axis.
// REQUIRES: the quantity is a position, or it is the gradient's magnitude and has a range.
frame::ColorRange ColorRangeOf(const frame::ColorBy& color_by,
                               const volume::GridGeometry& geometry);

// Returns the axis of a position: 0, 1 or 2. REQUIRES: the quantity is a position.
int AxisOf(frame::ColorBy::Quantity quantity);

}  // namespace isoscope::picture

#endif  // ISOSCOPE_CORE_PICTURE_COLOR_MAP_H_
