// PNG's filter "up" (PNG specification, 9.2) on rows of RGBA pixels, vectorised: the processor's
// best instructions are chosen at run time and all give the same bytes.

#ifndef ISOSCOPE_CORE_IMAGE_PNG_FILTER_H_
#define ISOSCOPE_CORE_IMAGE_PNG_FILTER_H_

#include <cstddef>
#include <cstdint>
#include <span>

#include "core/image/frame_image.h"

namespace isoscope::image {

enum class PngChannels : std::uint8_t { kRgb = 3, kRgba = 4 };

// FilterUp may write this many bytes, of no meaning, behind those it returns.
inline constexpr std::size_t kFilterSlackBytes = 16;

// Writes `row` minus `above`, byte by byte modulo 256, without the fourth byte of each pixel for
// kRgb. Returns the end of what it wrote: `out` + row.size() * channels.
// REQUIRES: above.size() == row.size(); kFilterSlackBytes more at `out` than it returns; no
// overlap. Thread-safe.
std::uint8_t* FilterUp(std::span<const Rgba8> row, std::span<const Rgba8> above,
                       PngChannels channels, std::uint8_t* out);

// Whether the alpha of all of them is 255. Thread-safe.
bool AllOpaque(std::span<const Rgba8> pixels);

}  // namespace isoscope::image

#endif  // ISOSCOPE_CORE_IMAGE_PNG_FILTER_H_
