// A unit vector and a step of a colour map in the 32 bits of a colour. Surfaces whose colour shows
// a value that does not follow from the position use it.
//
//   r, g, b   the code of the vector (normal_code.h) with 12 bits for each coordinate: at most 0.1
//             degrees off
//   a         the step, 0 to 255
//
// Where the value is missing (NaN) there is no step. The second coordinate is then -2048, which no
// vector has. The other 20 bits hold the vector with 10 bits for each coordinate: at most 0.4
// degrees off.

#ifndef ISOSCOPE_CORE_IMAGE_NORMAL_AND_STEP_H_
#define ISOSCOPE_CORE_IMAGE_NORMAL_AND_STEP_H_

#include <algorithm>
#include <cstdint>

#include "core/image/fragment.h"
#include "core/image/normal_code.h"

namespace isoscope::image {

namespace internal {

// The largest value of a coordinate. One less than the least value stands for no vector.
inline constexpr int kMaxShortCoordinate = 2047;
inline constexpr int kMaxCoordinate = 32767;
inline constexpr int kNoVector = -2048;
// The same with 10 bits.
inline constexpr int kMaxTinyCoordinate = 511;
inline constexpr int kNoTinyVector = -512;
// The second coordinate of a code without a step.
inline constexpr int kNoStep = -2048;

// `value` * to / from, rounded to the nearest whole number, halves away from 0.
constexpr int Rescaled(int value, int from, int to) {
  const int twice = 2 * value * to;
  return (twice + (value < 0 ? -from : from)) / (2 * from);
}
constexpr std::uint8_t ByteOf(int bits) { return static_cast<std::uint8_t>(bits & 0xff); }
// The value of the lowest 12 bits, and of the lowest 10.
constexpr int ShortCoordinateOf(int bits) { return ((bits & 0xfff) ^ 0x800) - 0x800; }
constexpr int TinyCoordinateOf(int bits) { return ((bits & 0x3ff) ^ 0x200) - 0x200; }

// The coordinates of a code, as EncodeNormal makes it, rescaled to a smaller number; `none`, 0 if
// it has no vector.
struct Coordinates {
  int x = 0;
  int y = 0;
};
constexpr Coordinates CoordinatesOf(Rgba8 normal, int max, int none) {
  if (normal == kNoNormal) {
    return {none, 0};
  }
  const auto value = [](std::uint8_t high, std::uint8_t low) {
    return int{static_cast<std::int16_t>(high << 8 | low)};
  };
  return {Rescaled(value(normal.r, normal.g), kMaxCoordinate, max),
          Rescaled(value(normal.b, normal.a), kMaxCoordinate, max)};
}

// The code of coordinates in [-max, max].
constexpr Rgba8 NormalOfCoordinates(const Coordinates& from, int max) {
  const int a = Rescaled(from.x, max, kMaxCoordinate);
  const int b = Rescaled(from.y, max, kMaxCoordinate);
  return {ByteOf(a >> 8), ByteOf(a), ByteOf(b >> 8), ByteOf(b)};
}

}  // namespace internal

// REQUIRES: `normal` is a result of EncodeNormal.
constexpr Rgba8 EncodeNormalAndStep(Rgba8 normal, std::uint8_t step) {
  const auto [x, y] =
      internal::CoordinatesOf(normal, internal::kMaxShortCoordinate, internal::kNoVector);
  const int bits = (x & 0xfff) << 12 | (y & 0xfff);
  return {internal::ByteOf(bits >> 16), internal::ByteOf(bits >> 8), internal::ByteOf(bits), step};
}

// The code of a vector where the value is missing. REQUIRES: as above.
constexpr Rgba8 EncodeNormalWithoutStep(Rgba8 normal) {
  const auto [x, y] =
      internal::CoordinatesOf(normal, internal::kMaxTinyCoordinate, internal::kNoTinyVector);
  const int vector = (x & 0x3ff) << 10 | (y & 0x3ff);
  const int bits = (vector >> 8) << 12 | (internal::kNoStep & 0xfff);
  return {internal::ByteOf(bits >> 16), internal::ByteOf(bits >> 8), internal::ByteOf(bits),
          internal::ByteOf(vector)};
}

// False where the value is missing.
constexpr bool HasStep(Rgba8 code) {
  return internal::ShortCoordinateOf(code.g << 8 | code.b) != internal::kNoStep;
}

// Returns the code of the vector, as DecodeNormal takes it; kNoNormal if there is none. Any bits
// give a code.
constexpr Rgba8 NormalOf(Rgba8 code) {
  const int bits = code.r << 16 | code.g << 8 | code.b;
  const int x = internal::ShortCoordinateOf(bits >> 12);
  if (HasStep(code)) {
    return x == internal::kNoVector
               ? kNoNormal
               : internal::NormalOfCoordinates({x, internal::ShortCoordinateOf(bits)},
                                               internal::kMaxShortCoordinate);
  }
  const int vector = (bits >> 12) << 8 | code.a;
  const internal::Coordinates tiny{internal::TinyCoordinateOf(vector >> 10),
                                   internal::TinyCoordinateOf(vector)};
  return tiny.x == internal::kNoTinyVector
             ? kNoNormal
             : internal::NormalOfCoordinates(
                   {tiny.x, std::max(tiny.y, -internal::kMaxTinyCoordinate)},
                   internal::kMaxTinyCoordinate);
}

// REQUIRES: HasStep(code).
constexpr std::uint8_t StepOf(Rgba8 code) { return code.a; }

}  // namespace isoscope::image

#endif  // ISOSCOPE_CORE_IMAGE_NORMAL_AND_STEP_H_
