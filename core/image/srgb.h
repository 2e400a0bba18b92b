// 8-bit sRGB and linear light. Averages and mixtures of light are right only in linear light.

#ifndef ISOSCOPE_CORE_IMAGE_SRGB_H_
#define ISOSCOPE_CORE_IMAGE_SRGB_H_

#include <cstdint>

namespace isoscope::image {

// Returns the linear light of an sRGB value, in [0, 1] (IEC 61966-2-1). Thread-safe, as SrgbOf.
float LinearOf(std::uint8_t srgb);

// Returns the sRGB value nearest to a linear light, which is clamped to [0, 1]; 0 for NaN.
// SrgbOf(LinearOf(x)) == x.
std::uint8_t SrgbOf(float linear);

}  // namespace isoscope::image

#endif  // ISOSCOPE_CORE_IMAGE_SRGB_H_
