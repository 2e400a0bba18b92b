#include "core/image/srgb.h"

#include <cmath>

namespace isoscope::image {
namespace {

double LinearOfUnit(double srgb) {
  return srgb <= 0.04045 ? srgb / 12.92 : std::pow((srgb + 0.055) / 1.055, 2.4);
}

}  // namespace

SrgbTable::SrgbTable() {
  for (std::size_t i = 0; i < linear_.size(); ++i) {
    linear_[i] = static_cast<float>(LinearOfUnit(static_cast<double>(i) / 255));
  }
  for (std::size_t i = 0; i < begins_.size(); ++i) {
    begins_[i] = static_cast<float>(LinearOfUnit((static_cast<double>(i) + 0.5) / 255));
  }
  std::uint8_t value = 0;
  for (std::size_t step = 0; step < first_.size(); ++step) {
    while (value < begins_.size() &&
           begins_[value] <= static_cast<float>(step) / static_cast<float>(kSteps)) {
      ++value;
    }
    first_[step] = value;
  }
}

const SrgbTable& SrgbTable::Get() {
  static const SrgbTable table;
  return table;
}

}  // namespace isoscope::image
