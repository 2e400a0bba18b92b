// The z-order of a grid (G. M. Morton, 1966): what is near in it is mostly near in the grid.

#ifndef ISOSCOPE_CORE_MATH_Z_ORDER_H_
#define ISOSCOPE_CORE_MATH_Z_ORDER_H_

#include <cstdint>

#include "core/math/vec.h"

namespace isoscope::math {

// Whether `a` comes before `b`. The axis whose indices differ in the highest bit decides; of equal
// bits z before y before x. No code is made, so indices may have all 63 bits. REQUIRES: none is
// negative.
inline bool IsBeforeInZOrder(const Index3& a, const Index3& b) {
  int deciding = 2;
  std::uint64_t most = 0;
  for (int axis = 2; axis >= 0; --axis) {
    const std::uint64_t differing =
        static_cast<std::uint64_t>(a[axis]) ^ static_cast<std::uint64_t>(b[axis]);
    // Whether its highest bit is above that of `most`.
    if (most < differing && most < (most ^ differing)) {
      deciding = axis;
      most = differing;
    }
  }
  return a[deciding] < b[deciding];
}

}  // namespace isoscope::math

#endif  // ISOSCOPE_CORE_MATH_Z_ORDER_H_
