#include "core/cli/format.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/units.h"

namespace isoscope::cli {
namespace {

// Puts a comma before every third digit of the whole part.
std::string WithSeparators(const std::string& number) {
  const std::size_t begin = number[0] == '-' ? 1 : 0;
  const std::size_t end = std::min(number.find('.'), number.size());
  std::string grouped = number.substr(0, begin);
  for (std::size_t i = begin; i < end; ++i) {
    if (i > begin && (end - i) % 3 == 0) {
      grouped += ',';
    }
    grouped += number[i];
  }
  return grouped + number.substr(end);
}

}  // namespace

std::string FormatCount(std::int64_t value) { return WithSeparators(absl::StrCat(value)); }

std::string FormatMebibytes(std::int64_t bytes) {
  return WithSeparators(absl::StrFormat(
             "%.1f", static_cast<double>(bytes) / static_cast<double>(base::kMiB))) +
         " MiB";
}

std::string FormatMilliseconds(double milliseconds) {
  return WithSeparators(absl::StrFormat("%.1f", milliseconds));
}

std::string FormatElapsed(absl::Duration duration) {
  const std::int64_t seconds = absl::ToInt64Seconds(duration + absl::Milliseconds(500));
  if (seconds < 60) {
    return absl::StrFormat("%d s", seconds);
  }
  if (seconds < 3600) {
    return absl::StrFormat("%d min %02d s", seconds / 60, seconds % 60);
  }
  return absl::StrFormat("%d h %02d min", seconds / 3600, seconds / 60 % 60);
}

std::string FormatShortest(double value) {
  std::array<char, 32> text;
  const std::to_chars_result end = std::to_chars(text.data(), text.data() + text.size(), value);
  return {text.data(), end.ptr};
}

std::string FormatValue(double value) {
  const bool is_whole = value == std::trunc(value) && std::abs(value) <= 0x1.0p53;
  return is_whole ? absl::StrCat(static_cast<std::int64_t>(value)) : FormatShortest(value);
}

std::string FormatCoordinate(double value) {
  const auto narrow = static_cast<float>(value);
  if (static_cast<double>(narrow) != value) {
    return FormatShortest(value);
  }
  std::array<char, 32> text;
  const std::to_chars_result end = std::to_chars(text.data(), text.data() + text.size(), narrow);
  return {text.data(), end.ptr};
}

}  // namespace isoscope::cli
