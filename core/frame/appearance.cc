#include "core/frame/appearance.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace isoscope::frame {

ColorRange ColorRangeOfSamples(double min, double max) {
  // So that the range is finite, whatever samples there are.
  constexpr double kLimit = std::numeric_limits<double>::max() / 4;
  ColorRange range{.min = std::clamp(min, -kLimit, kLimit),
                   .max = std::clamp(max, -kLimit, kLimit)};
  if (!(range.max > range.min)) {
    range.max = std::nextafter(range.min, std::numeric_limits<double>::infinity());
  }
  return range;
}

}  // namespace isoscope::frame
