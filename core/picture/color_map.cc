// A map is kept as 33 colours at equal distances. Between two of them each channel is linear in
// sRGB values. The colours were fitted to the published maps by least squares: no step is farther
// than 6 of 255 from the original, and most are within 1.

#include "core/picture/color_map.h"

#include <cmath>
#include <cstdint>

#include "core/base/check.h"

namespace isoscope::picture {
namespace {

constexpr std::size_t kPointCount = 33;
using Points = std::array<std::uint32_t, kPointCount>;  // 0xRRGGBB

// N. Smith, S. van der Walt, E. Firing 2015, CC0.
constexpr Points kViridis = {0x440154, 0x470d60, 0x48186a, 0x482374, 0x472d7b, 0x453681, 0x424086,
                             0x3f4989, 0x3b528b, 0x375a8d, 0x33638d, 0x2f6a8e, 0x2c728e, 0x297a8e,
                             0x26818e, 0x23898e, 0x21908d, 0x1f988b, 0x1e9f88, 0x21a685, 0x27ae80,
                             0x31b57b, 0x3dbc74, 0x4cc26c, 0x5cc963, 0x6ece58, 0x81d44c, 0x96d840,
                             0xabdc32, 0xc0df24, 0xd5e219, 0xeae519, 0xfde725};

// N. Smith, S. van der Walt 2015, CC0.
constexpr Points kMagma = {0x000004, 0x030311, 0x0a0822, 0x130d33, 0x1d1146, 0x28125a, 0x36106b,
                           0x430f76, 0x50127c, 0x5d177f, 0x691c81, 0x762181, 0x822682, 0x8f2a81,
                           0x9c2e7f, 0xa9327d, 0xb6377a, 0xc33b75, 0xd04170, 0xdb486a, 0xe65063,
                           0xef5c5e, 0xf5695b, 0xf9785c, 0xfc8761, 0xfd9668, 0xfea571, 0xfeb47b,
                           0xfec387, 0xfed194, 0xfde0a1, 0xfceeb0, 0xfcfdbf};

// Nunez, Anderton, Renslow 2018, "Optimizing colormaps with consideration for color vision
// deficiency", CC0.
constexpr Points kCividis = {0x00224e, 0x00285b, 0x002e6b, 0x043372, 0x1c386f, 0x273e6e, 0x32436d,
                             0x3b496c, 0x434e6c, 0x4b546c, 0x52596d, 0x5a5f6e, 0x61646f, 0x686a71,
                             0x6f7073, 0x757676, 0x7c7b78, 0x848179, 0x8b8778, 0x938d78, 0x9b9376,
                             0xa39a75, 0xaba072, 0xb3a670, 0xbbad6d, 0xc3b469, 0xccba64, 0xd4c15f,
                             0xddc958, 0xe6d051, 0xefd748, 0xf9df3b, 0xfee838};

// A. Mikhailov 2019, "Turbo, an improved rainbow colormap", Apache-2.0.
constexpr Points kTurbo = {0x30123b, 0x3a2a74, 0x4040a2, 0x4556c7, 0x476be4, 0x477ff7, 0x4393ff,
                           0x37a8fb, 0x29bbec, 0x1ccdd8, 0x17dcc3, 0x1de8b0, 0x30f299, 0x4cf97e,
                           0x6bfe63, 0x8aff4c, 0xa3fd3c, 0xb8f734, 0xcced34, 0xdee037, 0xedd03a,
                           0xf8c03a, 0xfdae35, 0xfe982c, 0xfc8022, 0xf56817, 0xec520e, 0xe14009,
                           0xd23105, 0xc12302, 0xac1701, 0x950c01, 0x7a0403};

// Computed from the formula of Moreland 2009, "Diverging color maps for scientific visualization":
// from (59, 76, 192) to (180, 4, 38) through (221, 221, 221) in his Msh space.
constexpr Points kCoolWarm = {0x3b4cc0, 0x445acc, 0x4e68d7, 0x5875e1, 0x6282ea, 0x6c8ef1, 0x779af7,
                              0x82a5fb, 0x8db0fe, 0x98b9ff, 0xa3c2ff, 0xaec9fd, 0xb8d0f9, 0xc2d5f4,
                              0xccd9ee, 0xd5dbe6, 0xdddddd, 0xe5d9d1, 0xecd3c6, 0xf1ccb9, 0xf5c4ad,
                              0xf7bba0, 0xf8b194, 0xf7a687, 0xf59a7b, 0xf18d6f, 0xec7f63, 0xe57057,
                              0xde614c, 0xd55042, 0xcb3e38, 0xc02a2f, 0xb40426};

image::Rgba8 Mix(std::uint32_t from, std::uint32_t to, double share) {
  const auto channel = [&](int shift) {
    const auto a = static_cast<double>(from >> shift & 0xff);
    const auto b = static_cast<double>(to >> shift & 0xff);
    return static_cast<std::uint8_t>(std::lround(a + (b - a) * share));
  };
  return {channel(16), channel(8), channel(0), 255};
}

ColorMapTable MakeTable(const Points& points) {
  ColorMapTable table;
  for (std::size_t i = 0; i < table.size(); ++i) {
    const double at = static_cast<double>(i) * (kPointCount - 1) / (kColorMapSteps - 1);
    const std::size_t point = std::min(static_cast<std::size_t>(at), kPointCount - 2);
    table[i] = Mix(points[point], points[point + 1], at - static_cast<double>(point));
  }
  return table;
}

ColorMapTable MakeGrey() {
  ColorMapTable table;
  for (std::size_t i = 0; i < table.size(); ++i) {
    const auto value = static_cast<std::uint8_t>(i);
    table[i] = {value, value, value, 255};
  }
  return table;
}

}  // namespace

const ColorMapTable& ColorMapTableOf(frame::ColorMap map) {
  static const std::array<ColorMapTable, 6> tables = {MakeTable(kViridis),  MakeTable(kMagma),
                                                      MakeTable(kCividis),  MakeTable(kTurbo),
                                                      MakeTable(kCoolWarm), MakeGrey()};
  return tables[static_cast<std::size_t>(map)];
}

int AxisOf(frame::ColorBy::Quantity quantity) {
  ISOSCOPE_CHECK(quantity != frame::ColorBy::Quantity::kNormal &&
                 quantity != frame::ColorBy::Quantity::kGradientMagnitude &&
                 quantity != frame::ColorBy::Quantity::kField);
  return static_cast<int>(quantity);
}

frame::ColorRange ColorRangeOf(const frame::ColorBy& color_by,
                               const volume::GridGeometry& geometry) {
  if (color_by.range.has_value()) {
    return *color_by.range;
  }
  const int axis = AxisOf(color_by.quantity);
  const math::Box3d bounds = geometry.Bounds();
  return {.min = bounds.min[axis], .max = bounds.max[axis]};
}

}  // namespace isoscope::picture
