#include "core/source/remote/retry_policy.h"

#include <algorithm>
#include <cstdint>
#include <string>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"

namespace isoscope::source {
namespace {

// RFC 9110, section 5.6.7: "Sun, 06 Nov 1994 08:49:37 GMT".
std::optional<absl::Time> ParseHttpDate(absl::string_view text) {
  absl::Time date;
  std::string error;
  if (!absl::ParseTime("%a, %d %b %Y %H:%M:%S GMT", std::string(text), &date, &error)) {
    return std::nullopt;
  }
  return date;
}

}  // namespace

bool IsRetryableStatus(int http_status) {
  return http_status == 408 || http_status == 429 || http_status == 500 || http_status == 502 ||
         http_status == 503 || http_status == 504;
}

absl::Duration RetryDelay(const RetryRules& rules, int failures, double unit) {
  const std::int64_t factor = std::int64_t{1} << std::clamp(failures - 1, 0, 30);
  return std::min(rules.first_delay * factor, rules.max_delay) * (0.5 + 0.5 * unit);
}

std::optional<absl::Duration> ParseRetryAfter(absl::string_view value, absl::string_view date) {
  value = absl::StripAsciiWhitespace(value);
  std::uint32_t seconds = 0;  // more than 100 years is no wait
  if (absl::SimpleAtoi(value, &seconds)) {
    return absl::Seconds(seconds);
  }
  const auto until = ParseHttpDate(value);
  const auto now = ParseHttpDate(absl::StripAsciiWhitespace(date));
  if (!until || !now) {
    return std::nullopt;
  }
  return std::max(*until - *now, absl::ZeroDuration());
}

}  // namespace isoscope::source
