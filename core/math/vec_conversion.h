// Vectors of floats from vectors of doubles, and back.

#ifndef ISOSCOPE_CORE_MATH_VEC_CONVERSION_H_
#define ISOSCOPE_CORE_MATH_VEC_CONVERSION_H_

#include "core/math/vec.h"

namespace isoscope::math {

constexpr Vec3d DoubleOf(const Vec3f& v) {
  return {static_cast<double>(v.x), static_cast<double>(v.y), static_cast<double>(v.z)};
}
constexpr Vec3f FloatOf(const Vec3d& v) {
  return {static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z)};
}

}  // namespace isoscope::math

#endif  // ISOSCOPE_CORE_MATH_VEC_CONVERSION_H_
