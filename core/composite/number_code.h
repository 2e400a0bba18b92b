// The code of the differences that a band of pixels sends: one of 16 classes, and extra bits
// (docs/format/wire.md, "Pixel band").
//
// Example: a depth 100 above the predicted one is ZigZag(100) = 200. Class 4 begins at 139 and has
// 8 extra bits, so it is sent as class 4 and 200 - 139 = 61 in 8 bits. A depth 5 below is
// ZigZag(-5) = 9: class 2, which begins at 3, and 6 in 3 bits.

#ifndef ISOSCOPE_CORE_COMPOSITE_NUMBER_CODE_H_
#define ISOSCOPE_CORE_COMPOSITE_NUMBER_CODE_H_

#include <array>
#include <cstddef>
#include <cstdint>

namespace isoscope::composite {

// Maps differences of either sign to numbers, small to small: 0, -1, 1, -2 to 0, 1, 2, 3.
constexpr std::uint32_t ZigZag(std::uint32_t difference) {
  return difference << 1 ^ (0U - (difference >> 31));
}
constexpr std::uint32_t UnZigZag(std::uint32_t code) { return code >> 1 ^ (0U - (code & 1)); }

// Class c has the 2^bits[c] numbers from bases[c] on; the next class begins behind them.
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
// Differences of palette indices, of some hundred colours; the last class is for whole colours.
inline constexpr NumberCode kColorCode({0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 13, 16, 32});
// The most extra bits that a depth or a colour has.
inline constexpr std::size_t kMaxExtraBits = 32;

// A decoded control byte: its low half is the class of the depth, its high half that of the colour.
struct Control {
  std::uint32_t depth_base = 0;
  std::uint32_t color_base = 0;
  std::uint32_t depth_bits = 0;
  std::uint32_t all_bits = 0;  // of depth and colour
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

// ClassifyNumbers may read this many numbers, and write this many bytes, past the last.
inline constexpr std::size_t kClassifyPadding = 15;

// Writes the control bytes of `count` pixels. The same on every instruction set. Thread-safe.
//
// depths, colors: ZigZag codes; kClassifyPadding more are readable
// controls:       capacity count + kClassifyPadding
void ClassifyNumbers(const std::uint32_t* depths, const std::uint32_t* colors, std::size_t count,
                     std::uint8_t* controls);

}  // namespace isoscope::composite

#endif  // ISOSCOPE_CORE_COMPOSITE_NUMBER_CODE_H_
