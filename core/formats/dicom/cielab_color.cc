// CIELab to XYZ by CIE 15, XYZ to sRGB by IEC 61966-2-1.
//
// DICOM means the white point D50 of ICC profiles, but the files of dcmqi give the colours of its
// descriptions with that of sRGB, D65. In a file that means D50, red and blue come out up to 6 of
// 255 off.

#include "core/formats/dicom/cielab_color.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/math/elementary.h"

namespace isoscope::source {
namespace {

// The inverse of CIELab's cube root with its straight part.
double Cube(double root) {
  constexpr double kEdge = 6.0 / 29;
  return root > kEdge ? root * root * root : 3 * kEdge * kEdge * (root - 4.0 / 29);
}

std::uint8_t ByteOf(double light) {
  light = std::clamp(light, 0.0, 1.0);
  const double value =
      light <= 0.0031308 ? 12.92 * light : 1.055 * math::Pow(light, 1 / 2.4) - 0.055;
  return static_cast<std::uint8_t>(std::floor(255 * value + 0.5));
}

}  // namespace

volume::LabelColor ColorOfCieLab(const math::Vec3d& lab) {
  const double middle = (lab.x + 16) / 116;
  const double x = 0.950456 * Cube(middle + lab.y / 500);
  const double y = Cube(middle);
  const double z = 1.088754 * Cube(middle - lab.z / 200);
  return {.red = ByteOf(3.2404542 * x - 1.5371385 * y - 0.4985314 * z),
          .green = ByteOf(-0.9692660 * x + 1.8760108 * y + 0.0415560 * z),
          .blue = ByteOf(0.0556434 * x - 0.2040259 * y + 1.0572252 * z)};
}

}  // namespace isoscope::source
