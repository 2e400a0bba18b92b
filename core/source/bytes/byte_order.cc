#include "core/source/bytes/byte_order.h"

#include <algorithm>
#include <array>

namespace isoscope::source {
namespace {

template <std::size_t kSize>
void SwapEach(std::size_t count, char* samples) {
  for (std::size_t i = 0; i < count; ++i) {
    std::array<char, kSize> sample;
    std::copy_n(samples + i * kSize, kSize, sample.begin());
    std::reverse_copy(sample.begin(), sample.end(), samples + i * kSize);
  }
}

}  // namespace

void SwapBytes(std::size_t sample_size, std::size_t count, char* samples) {
  switch (sample_size) {
    case 2:
      return SwapEach<2>(count, samples);
    case 4:
      return SwapEach<4>(count, samples);
    case 8:
      return SwapEach<8>(count, samples);
    default:
      return;
  }
}

}  // namespace isoscope::source
