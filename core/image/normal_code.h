// A unit vector in the 32 bits of a colour, so that normals travel as colours do.
//
// The vector is projected onto the octahedron |x| + |y| + |z| = 1, whose lower half is folded out,
// and the two coordinates are rounded to 16 bits each: at most 0.01 degrees off. Source: Cigolle et
// al. 2014, "A survey of efficient representations for independent unit vectors".

#ifndef ISOSCOPE_CORE_IMAGE_NORMAL_CODE_H_
#define ISOSCOPE_CORE_IMAGE_NORMAL_CODE_H_

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "core/image/fragment.h"

namespace isoscope::image {

// The code of a surface without a normal. No vector has it: coordinates are at least -32767.
inline constexpr Rgba8 kNoNormal{0x80, 0x00, 0x80, 0x00};

// Returns the code of the direction of `v`, of any length; kNoNormal if that is 0 or not finite.
// The same bits on every machine.
inline Rgba8 EncodeNormal(const std::array<double, 3>& v) {
  const double sum = std::abs(v[0]) + std::abs(v[1]) + std::abs(v[2]);
  if (!(sum > 0) || !std::isfinite(sum)) {
    return kNoNormal;
  }
  double x = v[0] / sum;
  double y = v[1] / sum;
  if (v[2] < 0) {
    const double folded_x = (1 - std::abs(y)) * (x < 0 ? -1 : 1);
    y = (1 - std::abs(x)) * (y < 0 ? -1 : 1);
    x = folded_x;
  }
  const auto quantize = [](double value) {
    return static_cast<std::uint16_t>(
        static_cast<std::int16_t>(std::lround(std::clamp(value, -1.0, 1.0) * 32767)));
  };
  const std::uint16_t a = quantize(x);
  const std::uint16_t b = quantize(y);
  return {static_cast<std::uint8_t>(a >> 8), static_cast<std::uint8_t>(a & 0xff),
          static_cast<std::uint8_t>(b >> 8), static_cast<std::uint8_t>(b & 0xff)};
}

// Returns the unit vector of a code; 0, 0, 0 for kNoNormal. Any code gives a finite vector.
inline std::array<float, 3> DecodeNormal(Rgba8 code) {
  if (code == kNoNormal) {
    return {0, 0, 0};
  }
  const auto value = [](std::uint8_t high, std::uint8_t low) {
    return std::max(static_cast<std::int16_t>(high << 8 | low) / 32767.0, -1.0);
  };
  double x = value(code.r, code.g);
  double y = value(code.b, code.a);
  const double z = 1 - std::abs(x) - std::abs(y);
  if (z < 0) {
    const double folded_x = (1 - std::abs(y)) * (x < 0 ? -1 : 1);
    y = (1 - std::abs(x)) * (y < 0 ? -1 : 1);
    x = folded_x;
  }
  const double length = std::sqrt(x * x + y * y + z * z);
  return {static_cast<float>(x / length), static_cast<float>(y / length),
          static_cast<float>(z / length)};
}

}  // namespace isoscope::image

#endif  // ISOSCOPE_CORE_IMAGE_NORMAL_CODE_H_
