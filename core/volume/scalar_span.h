// The span of a block's samples, and the one definition of "active".

#ifndef ISOSCOPE_CORE_VOLUME_SCALAR_SPAN_H_
#define ISOSCOPE_CORE_VOLUME_SCALAR_SPAN_H_

#include <cmath>
#include <limits>
#include <type_traits>

namespace isoscope::volume {

// [min, max] over the samples of a block, ghost samples and NaN left out. min > max: no sample
// counted, never active. Every sample type is exact in double.
struct ScalarSpan {
  double min = std::numeric_limits<double>::infinity();
  double max = -std::numeric_limits<double>::infinity();

  friend constexpr bool operator==(const ScalarSpan&, const ScalarSpan&) = default;
};

// Returns true if there are samples, and all of them are finite.
inline bool IsFinite(const ScalarSpan& span) {
  return std::isfinite(span.min) && std::isfinite(span.max);
}

// Returns true if the surface passes through a block, cell or edge with these samples: a sample is
// inside iff sample >= isovalue (as in VTK), so min < isovalue <= max (docs/numerics.md).
constexpr bool IsActive(const ScalarSpan& span, double isovalue) {
  return span.min < isovalue && isovalue <= span.max;
}

// The smallest value of T that is inside.
template <typename T>
struct Threshold {
  bool any = false;  // false if no value of T is inside
  T value{};
};

// Returns the threshold of an isovalue, so that kernels compare in T: sample >= isovalue iff any &&
// sample >= value. NaN samples compare false. REQUIRES: isovalue is finite.
template <typename T>
Threshold<T> InsideThreshold(double isovalue) {
  if constexpr (std::is_same_v<T, double>) {
    return {true, isovalue};
  } else if constexpr (std::is_same_v<T, float>) {
    if (isovalue > static_cast<double>(std::numeric_limits<float>::max())) {
      return {true, std::numeric_limits<float>::infinity()};
    }
    if (isovalue < static_cast<double>(std::numeric_limits<float>::lowest())) {
      return {true, std::numeric_limits<float>::lowest()};
    }
    auto value = static_cast<float>(isovalue);
    if (static_cast<double>(value) < isovalue) {
      value = std::nextafter(value, std::numeric_limits<float>::infinity());
    }
    return {true, value};
  } else {
    const double smallest = std::ceil(isovalue);
    if (smallest > static_cast<double>(std::numeric_limits<T>::max())) {
      return {false, T{}};
    }
    if (smallest < static_cast<double>(std::numeric_limits<T>::lowest())) {
      return {true, std::numeric_limits<T>::lowest()};
    }
    return {true, static_cast<T>(smallest)};
  }
}

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_SCALAR_SPAN_H_
