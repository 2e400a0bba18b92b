// Sums of doubles without rounding, so that no order of adding can show.

#ifndef ISOSCOPE_CORE_MATH_EXACT_SUM_H_
#define ISOSCOPE_CORE_MATH_EXACT_SUM_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::math {

// The exact sum of any doubles, up to 2^60 of them. Thread-compatible.
class ExactSum {
 public:
  // A sum to which a NaN or an infinity was added has the value NaN.
  void Add(double value);
  void Add(const ExactSum& other);

  // The sum, rounded once to the nearest double, ties to even. Below 2^-1022 it may be off by the
  // last bit.
  [[nodiscard]] double Value() const;

  // The sum as bytes: equal sums give equal bytes.
  [[nodiscard]] std::string Encode() const;
  // INVALID_ARGUMENT unless Encode has made the bytes.
  static absl::StatusOr<ExactSum> Decode(absl::string_view bytes);

 private:
  // Digit i counts 2^(32 i - 1088): from below the smallest double to above 2^60 of the largest.
  static constexpr std::size_t kDigitCount = 70;

  // Brings all digits but the last to [0, 2^32).
  void Carry();

  std::array<std::int64_t, kDigitCount> digits_{};
  std::int32_t additions_ = 0;  // since the last Carry
  bool is_nan_ = false;
};

}  // namespace isoscope::math

#endif  // ISOSCOPE_CORE_MATH_EXACT_SUM_H_
