#include "core/image/srgb.h"

#include <array>
#include <cmath>
#include <cstddef>

namespace isoscope::image {
namespace {

double LinearOfUnit(double srgb) {
  return srgb <= 0.04045 ? srgb / 12.92 : std::pow((srgb + 0.055) / 1.055, 2.4);
}

struct Tables {
  // So many steps that at most a few sRGB values begin in one.
  static constexpr std::size_t kSteps = 4096;

  Tables() {
    for (std::size_t i = 0; i < linear.size(); ++i) {
      linear[i] = static_cast<float>(LinearOfUnit(static_cast<double>(i) / 255));
    }
    for (std::size_t i = 0; i < begins.size(); ++i) {
      begins[i] = static_cast<float>(LinearOfUnit((static_cast<double>(i) + 0.5) / 255));
    }
    std::uint8_t value = 0;
    for (std::size_t step = 0; step < first.size(); ++step) {
      while (value < begins.size() &&
             begins[value] <= static_cast<float>(step) / static_cast<float>(kSteps)) {
        ++value;
      }
      first[step] = value;
    }
  }

  std::array<float, 256> linear{};
  std::array<float, 255> begins{};               // where value i + 1 begins
  std::array<std::uint8_t, kSteps + 1> first{};  // the value at the beginning of each step
};

const Tables& TablesOnce() {
  static const Tables tables;
  return tables;
}

}  // namespace

float LinearOf(std::uint8_t srgb) { return TablesOnce().linear[srgb]; }

std::uint8_t SrgbOf(float linear) {
  if (!(linear > 0)) {
    return 0;
  }
  if (linear >= 1) {
    return 255;
  }
  const Tables& tables = TablesOnce();
  std::uint8_t value =
      tables.first[static_cast<std::size_t>(linear * static_cast<float>(Tables::kSteps))];
  while (value < tables.begins.size() && tables.begins[value] <= linear) {
    ++value;
  }
  return value;
}

}  // namespace isoscope::image
