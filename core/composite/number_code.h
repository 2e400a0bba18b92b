// How a band of pixels sends numbers: as one of 16 classes and some extra bits
// (docs/format/wire.md).

#ifndef ISOSCOPE_CORE_COMPOSITE_NUMBER_CODE_H_
#define ISOSCOPE_CORE_COMPOSITE_NUMBER_CODE_H_

#include <array>
#include <cstddef>
#include <cstdint>

namespace isoscope::composite {

// Small numbers for small differences of either sign.
constexpr std::uint32_t ZigZag(std::uint32_t difference) {
  return difference << 1 ^ (0U - (difference >> 31));
}
constexpr std::uint32_t UnZigZag(std::uint32_t code) { return code >> 1 ^ (0U - (code & 1)); }

// Class c has the numbers from bases[c] on, as many as bits[c] bits tell apart; the next class
// begins there.
struct NumberCode {
  constexpr explicit NumberCode(const std::array<std::uint8_t, 16>& extra_bits) : bits(extra_bits) {
    for (std::size_t c = 1; c < bits.size(); ++c) {
      bases[c] = bases[c - 1] + (std::uint32_t{1} << bits[c - 1]);
    }
  }

  std::array<std::uint8_t, 16> bits;
  std::array<std::uint32_t, 16> bases{};
};

// Measured on surfaces of CT and MRI scans and of random fields at 1024 x 1024: most differences of
// depth have 9 to 16 bits, and 0 to 2 where a triangle is many pixels wide.
inline constexpr NumberCode kDepthCode({0, 1, 3, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 18, 22, 32});
// Indices of a palette of some hundred colours; the last is for colours sent as they are.
inline constexpr NumberCode kColorCode({0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 13, 16, 32});
// Of a pixel: depth and colour, and the extra bits that one of them may have.
inline constexpr std::size_t kMaxExtraBits = 32;

// What a control byte means: the class of the depth in its low half, that of the colour in the
// high.
struct Control {
  std::uint32_t depth_base = 0;
  std::uint32_t color_base = 0;
  std::uint32_t depth_bits = 0;
  std::uint32_t all_bits = 0;
};
inline constexpr std::array<Control, 256> kControls = [] {
  std::array<Control, 256> controls{};
  for (std::size_t byte = 0; byte < controls.size(); ++byte) {
    const std::size_t depth = byte & 15;
    const std::size_t color = byte >> 4;
    controls[byte] = {kDepthCode.bases[depth], kColorCode.bases[color], kDepthCode.bits[depth],
                      std::uint32_t{kDepthCode.bits[depth]} + kColorCode.bits[color]};
  }
  return controls;
}();

// The numbers that ClassifyNumbers may read and the bytes that it may write past the last.
inline constexpr std::size_t kClassifyPadding = 15;

// The control bytes of `count` pixels, in vector lanes.
void ClassifyNumbers(const std::uint32_t* depths, const std::uint32_t* colors, std::size_t count,
                     std::uint8_t* controls);

}  // namespace isoscope::composite

#endif  // ISOSCOPE_CORE_COMPOSITE_NUMBER_CODE_H_
