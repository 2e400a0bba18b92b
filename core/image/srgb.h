// 8-bit sRGB and linear light. Averages and mixtures of light are right only in linear light.

#ifndef ISOSCOPE_CORE_IMAGE_SRGB_H_
#define ISOSCOPE_CORE_IMAGE_SRGB_H_

#include <array>
#include <cstddef>
#include <cstdint>

namespace isoscope::image {

// IEC 61966-2-1, by tables. Thread-safe.
class SrgbTable {
 public:
  static const SrgbTable& Get();

  // Returns the linear light of an sRGB value, in [0, 1].
  [[nodiscard]] float LinearOf(std::uint8_t srgb) const { return linear_[srgb]; }

  // Returns the sRGB value nearest to a linear light, which is clamped to [0, 1]; 0 for NaN.
  // SrgbOf(LinearOf(x)) == x.
  [[nodiscard]] std::uint8_t SrgbOf(float linear) const {
    if (!(linear > 0)) {
      return 0;
    }
    if (linear >= 1) {
      return 255;
    }
    std::uint8_t value = first_[static_cast<std::size_t>(linear * static_cast<float>(kSteps))];
    while (value < begins_.size() && begins_[value] <= linear) {
      ++value;
    }
    return value;
  }

 private:
  // So many that at most a few sRGB values begin in one.
  static constexpr std::size_t kSteps = 4096;

  SrgbTable();

  std::array<float, 256> linear_{};
  std::array<float, 255> begins_{};               // where value i + 1 begins
  std::array<std::uint8_t, kSteps + 1> first_{};  // the value at the beginning of each step
};

}  // namespace isoscope::image

#endif  // ISOSCOPE_CORE_IMAGE_SRGB_H_
