// A number in base 2^32, whose digits are int64 and carry late:
//
//   1. Add splits the 53 bits of a double over three digits.
//   2. Carry moves what exceeds 32 bits to the next digit, at the latest after 2^30 additions. No
//      digit overflows until then.
//   3. Value reads the highest bits, and rounds by those below.
//
// Example: 1.5 is 3 * 2^-1, and bit -1 is bit 1087 of the number: digit 33, bit 31. So the two set
// bits go to digit 33, bit 31, and digit 34, bit 0.
//
// Based on: R. M. Neal: Fast exact summation using small and large superaccumulators, 2015.

#include "core/math/exact_sum.h"

#include <bit>
#include <cmath>
#include <limits>

#include "absl/strings/str_cat.h"

#include "core/base/coding.h"

namespace isoscope::math {
namespace {

constexpr int kDigitBits = 32;
constexpr int kLowestExponent = -1088;
constexpr std::uint64_t kDigitMask = 0xffffffff;
constexpr std::int32_t kMaxAdditions = 1 << 30;

}  // namespace

void ExactSum::Add(double value) {
  if (!std::isfinite(value)) {
    is_nan_ = true;
    return;
  }
  int exponent = 0;
  // 53 bits as a whole number.
  const auto bits = static_cast<std::int64_t>(std::ldexp(std::frexp(value, &exponent), 53));
  if (bits == 0) {
    return;
  }
  const std::int64_t sign = bits < 0 ? -1 : 1;
  auto magnitude = static_cast<std::uint64_t>(bits < 0 ? -bits : bits);
  int lowest_bit = exponent - 53 - kLowestExponent;
  if (lowest_bit < 0) {  // doubles have no bits below 2^-1074
    magnitude >>= -lowest_bit;
    lowest_bit = 0;
  }
  const auto digit = static_cast<std::size_t>(lowest_bit / kDigitBits);
  const int shift = lowest_bit % kDigitBits;
  const std::uint64_t low = (magnitude & kDigitMask) << shift;
  const std::uint64_t high = (low >> kDigitBits) + (magnitude >> kDigitBits << shift);
  digits_[digit] += sign * static_cast<std::int64_t>(low & kDigitMask);
  digits_[digit + 1] += sign * static_cast<std::int64_t>(high & kDigitMask);
  digits_[digit + 2] += sign * static_cast<std::int64_t>(high >> kDigitBits);
  if (++additions_ == kMaxAdditions) {
    Carry();
  }
}

void ExactSum::Add(const ExactSum& other) {
  ExactSum carried = other;
  carried.Carry();
  Carry();
  for (std::size_t i = 0; i < kDigitCount; ++i) {
    digits_[i] += carried.digits_[i];
  }
  is_nan_ = is_nan_ || other.is_nan_;
  Carry();
}

void ExactSum::Carry() {
  for (std::size_t i = 0; i + 1 < kDigitCount; ++i) {
    digits_[i + 1] += digits_[i] >> kDigitBits;
    digits_[i] &= static_cast<std::int64_t>(kDigitMask);
  }
  additions_ = 0;
}

double ExactSum::Value() const {
  if (is_nan_) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  ExactSum sum = *this;
  sum.Carry();
  const bool is_negative = sum.digits_.back() < 0;
  if (is_negative) {
    for (std::int64_t& digit : sum.digits_) {
      digit = -digit;
    }
    sum.Carry();
  }
  std::size_t top = kDigitCount - 1;
  while (top > 0 && sum.digits_[top] == 0) {
    --top;
  }
  // The highest 64 bits, the last of them set if any below is; the conversion rounds the last 11.
  const auto digit_at = [&](std::size_t below_top) {
    return top >= below_top ? static_cast<std::uint64_t>(sum.digits_[top - below_top])
                            : std::uint64_t{0};
  };
  std::uint64_t bits = digit_at(0) << kDigitBits | digit_at(1);
  if (bits == 0) {
    return 0;
  }
  const int zeros = std::countl_zero(bits);
  const std::uint64_t below = digit_at(2) << zeros;
  bits = bits << zeros | below >> kDigitBits;
  bool has_more = (below & kDigitMask) != 0;
  for (std::size_t i = 0; i + 3 <= top; ++i) {
    has_more = has_more || sum.digits_[i] != 0;
  }
  bits |= has_more ? 1 : 0;
  const double value =
      std::ldexp(static_cast<double>(bits),
                 kLowestExponent + kDigitBits * (static_cast<int>(top) - 1) - zeros);
  return is_negative ? -value : value;
}

std::string ExactSum::Encode() const {
  ExactSum sum = *this;
  sum.Carry();
  std::string bytes;
  base::AppendLittleEndian(static_cast<std::uint8_t>(is_nan_ ? 1 : 0), &bytes);
  for (const std::int64_t digit : sum.digits_) {
    base::AppendLittleEndian(is_nan_ ? std::int64_t{0} : digit, &bytes);
  }
  return bytes;
}

absl::StatusOr<ExactSum> ExactSum::Decode(absl::string_view bytes) {
  constexpr std::size_t kBytes = 1 + kDigitCount * sizeof(std::int64_t);
  if (bytes.size() != kBytes) {
    return absl::InvalidArgumentError(
        absl::StrCat("exact sum of ", bytes.size(), " bytes, expected ", kBytes));
  }
  ExactSum sum;
  sum.is_nan_ = bytes[0] != 0;
  constexpr std::int64_t kMaxLast = std::int64_t{1} << 62;
  for (std::size_t i = 0; i < kDigitCount; ++i) {
    const auto digit =
        base::LoadLittleEndian<std::int64_t>(bytes.data() + 1 + i * sizeof(std::int64_t));
    const bool is_last = i + 1 == kDigitCount;
    if (is_last ? digit > kMaxLast || digit < -kMaxLast
                : static_cast<std::uint64_t>(digit) > kDigitMask) {
      return absl::InvalidArgumentError(
          absl::StrCat("exact sum with digit ", digit, " at ", i, ": out of range"));
    }
    sum.digits_[i] = digit;
  }
  return sum;
}

}  // namespace isoscope::math
