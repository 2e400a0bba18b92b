// Morton (Z-order) codes: neighbours in space lie near each other in the order.
// Source: Morton 1966, "A computer oriented geodetic data base".

#ifndef ISOSCOPE_CORE_MATH_MORTON_H_
#define ISOSCOPE_CORE_MATH_MORTON_H_

#include <cstdint>

namespace isoscope::math {

// Moves bit i of the low 21 bits of `x` to bit 3 i.
constexpr std::uint64_t SpreadBits3(std::uint64_t x) {
  x &= 0x1fffff;
  x = (x | x << 32) & 0x001f00000000ffff;
  x = (x | x << 16) & 0x001f0000ff0000ff;
  x = (x | x << 8) & 0x100f00f00f00f00f;
  x = (x | x << 4) & 0x10c30c30c30c30c3;
  x = (x | x << 2) & 0x1249249249249249;
  return x;
}

// REQUIRES: 0 <= x, y, z < 2^21. x is the fastest bit.
constexpr std::uint64_t MortonCode3(std::int64_t x, std::int64_t y, std::int64_t z) {
  return SpreadBits3(static_cast<std::uint64_t>(x)) |
         SpreadBits3(static_cast<std::uint64_t>(y)) << 1 |
         SpreadBits3(static_cast<std::uint64_t>(z)) << 2;
}

}  // namespace isoscope::math

#endif  // ISOSCOPE_CORE_MATH_MORTON_H_
