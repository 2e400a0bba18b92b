// sRGB values of 8 bits to linear light of 16 bits and back, by tables. The same bits on every
// machine: the tables are made with +, -, * and / alone.

#ifndef ISOSCOPE_CORE_PICTURE_LINEAR_LIGHT_H_
#define ISOSCOPE_CORE_PICTURE_LINEAR_LIGHT_H_

#include <array>
#include <cstddef>
#include <cstdint>

namespace isoscope::picture {

// Linear light of an sRGB value of 1.
inline constexpr std::uint32_t kFullLight = 65535;

struct LinearLightTables {
  std::array<std::uint16_t, 256> light;           // of an sRGB value
  std::array<std::uint8_t, kFullLight + 1> srgb;  // the nearest value of a light
};

// Thread-safe. The conversion to light and back is the identity.
const LinearLightTables& LinearLight();

}  // namespace isoscope::picture

#endif  // ISOSCOPE_CORE_PICTURE_LINEAR_LIGHT_H_
