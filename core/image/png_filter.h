// PNG's filter "up" (PNG specification, 9.2) on rows of RGBA pixels, compiled for several
// instruction sets: the best one is chosen at run time, and all give the same bytes.

#ifndef ISOSCOPE_CORE_IMAGE_PNG_FILTER_H_
#define ISOSCOPE_CORE_IMAGE_PNG_FILTER_H_

#include <cstddef>
#include <cstdint>
#include <span>

#include "core/image/frame_image.h"

namespace isoscope::image {

enum class PngChannels : std::uint8_t { kRgb = 3, kRgba = 4 };

// FilterUp may write up to this many meaningless bytes behind its result.
inline constexpr std::size_t kFilterSlackBytes = 16;

// Writes `row` minus `above`, byte by byte modulo 256, without the fourth byte of each pixel for
// kRgb. Returns out + row.size() * channels.
//
// out: capacity row.size() * channels + kFilterSlackBytes; overlaps neither row
//
// REQUIRES: above.size() == row.size(). Thread-safe.
std::uint8_t* FilterUp(std::span<const Rgba8> row, std::span<const Rgba8> above,
                       PngChannels channels, std::uint8_t* out);

// Returns true if the alpha of all pixels is 255. Thread-safe.
bool AllOpaque(std::span<const Rgba8> pixels);

}  // namespace isoscope::image

#endif  // ISOSCOPE_CORE_IMAGE_PNG_FILTER_H_
