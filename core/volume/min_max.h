// The least and the greatest of many samples.

#ifndef ISOSCOPE_CORE_VOLUME_MIN_MAX_H_
#define ISOSCOPE_CORE_VOLUME_MIN_MAX_H_

#include <array>
#include <cstddef>
#include <cstring>
#include <limits>
#include <type_traits>

#include "core/base/coding.h"
#include "core/volume/scalar_span.h"

namespace isoscope::volume {

// Accumulates in lanes, which the compiler keeps in vector registers. A NaN compares false and
// leaves its lane as it was. Thread-compatible.
template <typename T>
class MinMax {
 public:
  MinMax() {
    if constexpr (std::is_floating_point_v<T>) {
      min_.fill(std::numeric_limits<T>::infinity());
      max_.fill(-std::numeric_limits<T>::infinity());
    } else {
      min_.fill(std::numeric_limits<T>::max());
      max_.fill(std::numeric_limits<T>::lowest());
    }
  }

  // Adds `count` samples at `row`, little-endian, any alignment.
  void AddRow(const char* row, std::size_t count) {
    std::size_t i = 0;
    for (; i + kLanes <= count; i += kLanes) {
      std::array<T, kLanes> samples;
      std::memcpy(samples.data(), row + i * sizeof(T), sizeof(samples));
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        min_[lane] = samples[lane] < min_[lane] ? samples[lane] : min_[lane];
        max_[lane] = samples[lane] > max_[lane] ? samples[lane] : max_[lane];
      }
    }
    for (std::size_t lane = 0; i < count; ++i, ++lane) {
      const T sample = base::LoadLittleEndian<T>(row + i * sizeof(T));
      min_[lane] = sample < min_[lane] ? sample : min_[lane];
      max_[lane] = sample > max_[lane] ? sample : max_[lane];
    }
  }

  // Returns the span of all samples added. Equal samples give equal bits, in any order.
  [[nodiscard]] volume::ScalarSpan Get() const {
    T min = min_[0];
    T max = max_[0];
    for (std::size_t lane = 1; lane < kLanes; ++lane) {
      min = min_[lane] < min ? min_[lane] : min;
      max = max_[lane] > max ? max_[lane] : max;
    }
    // min > max only if no sample counted. Adding 0 turns -0 into +0, so that their order does not
    // matter.
    return min > max
               ? volume::ScalarSpan{}
               : volume::ScalarSpan{static_cast<double>(min) + 0.0, static_cast<double>(max) + 0.0};
  }

 private:
  static constexpr std::size_t kLanes = 16 / sizeof(T) < 4 ? 4 : 16 / sizeof(T);

  std::array<T, kLanes> min_;
  std::array<T, kLanes> max_;
};

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_MIN_MAX_H_
