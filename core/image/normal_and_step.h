// A unit vector and a step of a colour map in the 32 bits of a colour. Surfaces whose colour shows
// a value that does not follow from the position use it.
//
//   r, g, b   the code of the vector (normal_code.h) with 12 bits for each coordinate: at most 0.1
//             degrees off
//   a         the step, 0 to 255

#ifndef ISOSCOPE_CORE_IMAGE_NORMAL_AND_STEP_H_
#define ISOSCOPE_CORE_IMAGE_NORMAL_AND_STEP_H_

#include <cstdint>

#include "core/image/fragment.h"
#include "core/image/normal_code.h"

namespace isoscope::image {

namespace internal {

// The largest value of a coordinate. One less than the least value stands for no vector.
inline constexpr int kMaxShortCoordinate = 2047;
inline constexpr int kMaxCoordinate = 32767;
inline constexpr int kNoVector = -2048;

// `value` * to / from, rounded to the nearest whole number, halves away from 0.
constexpr int Rescaled(int value, int from, int to) {
  const int twice = 2 * value * to;
  return (twice + (value < 0 ? -from : from)) / (2 * from);
}
constexpr std::uint8_t ByteOf(int bits) { return static_cast<std::uint8_t>(bits & 0xff); }
// The value of the lowest 12 bits.
constexpr int ShortCoordinateOf(int bits) { return ((bits & 0xfff) ^ 0x800) - 0x800; }

}  // namespace internal

// REQUIRES: `normal` is a result of EncodeNormal.
constexpr Rgba8 EncodeNormalAndStep(Rgba8 normal, std::uint8_t step) {
  using internal::Rescaled;
  int x = internal::kNoVector;
  int y = 0;
  if (normal != kNoNormal) {
    const auto value = [](std::uint8_t high, std::uint8_t low) {
      return int{static_cast<std::int16_t>(high << 8 | low)};
    };
    x = Rescaled(value(normal.r, normal.g), internal::kMaxCoordinate,
                 internal::kMaxShortCoordinate);
    y = Rescaled(value(normal.b, normal.a), internal::kMaxCoordinate,
                 internal::kMaxShortCoordinate);
  }
  const int bits = (x & 0xfff) << 12 | (y & 0xfff);
  return {internal::ByteOf(bits >> 16), internal::ByteOf(bits >> 8), internal::ByteOf(bits), step};
}

// Returns the code of the vector, as DecodeNormal takes it; kNoNormal if there is none. Any bits
// give a code.
constexpr Rgba8 NormalOf(Rgba8 code) {
  using internal::Rescaled;
  const int bits = code.r << 16 | code.g << 8 | code.b;
  const int x = internal::ShortCoordinateOf(bits >> 12);
  if (x == internal::kNoVector) {
    return kNoNormal;
  }
  const int y = internal::ShortCoordinateOf(bits) == internal::kNoVector
                    ? -internal::kMaxShortCoordinate
                    : internal::ShortCoordinateOf(bits);
  const int a = Rescaled(x, internal::kMaxShortCoordinate, internal::kMaxCoordinate);
  const int b = Rescaled(y, internal::kMaxShortCoordinate, internal::kMaxCoordinate);
  return {internal::ByteOf(a >> 8), internal::ByteOf(a), internal::ByteOf(b >> 8),
          internal::ByteOf(b)};
}

constexpr std::uint8_t StepOf(Rgba8 code) { return code.a; }

}  // namespace isoscope::image

#endif  // ISOSCOPE_CORE_IMAGE_NORMAL_AND_STEP_H_
