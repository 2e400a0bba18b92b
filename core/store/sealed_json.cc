#include "core/store/sealed_json.h"

#include "absl/status/status.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/crc32c.h"

namespace isoscope::store {
namespace {

// Inside a JSON string its quotes would be escaped, so it only matches a member of that name.
constexpr absl::string_view kSealPrefix = "\"crc32c\": \"";
constexpr absl::string_view kBlankDigits = "00000000";

// Returns the offset of the digits, or npos unless there is exactly one complete seal.
std::size_t FindDigits(absl::string_view text) {
  const std::size_t prefix = text.find(kSealPrefix);
  if (prefix == absl::string_view::npos ||
      text.find(kSealPrefix, prefix + 1) != absl::string_view::npos) {
    return absl::string_view::npos;
  }
  const std::size_t digits = prefix + kSealPrefix.size();
  return text.size() > digits + kBlankDigits.size() ? digits : absl::string_view::npos;
}

}  // namespace

std::string SealJson(std::string text) {
  const std::size_t digits = FindDigits(text);
  ISOSCOPE_CHECK(digits != std::string::npos);
  ISOSCOPE_CHECK(absl::string_view(text).substr(digits, kBlankDigits.size()) == kBlankDigits);
  const std::uint32_t crc32c = base::Crc32c(text);
  text.replace(digits, kBlankDigits.size(), absl::StrFormat("%08x", crc32c));
  return text;
}

absl::StatusOr<std::uint32_t> VerifySeal(absl::string_view text, absl::string_view where) {
  const std::size_t digits = FindDigits(text);
  if (digits == absl::string_view::npos) {
    return absl::DataLossError(absl::StrFormat(
        "%s: %d bytes without exactly one member \"crc32c\": truncated, damaged or no file of "
        "Isoscope",
        where, text.size()));
  }
  const absl::string_view stored = text.substr(digits, kBlankDigits.size());
  std::uint32_t crc32c = base::Crc32c(text.substr(0, digits));
  crc32c = base::ExtendCrc32c(crc32c, kBlankDigits.data(), kBlankDigits.size());
  const absl::string_view rest = text.substr(digits + kBlankDigits.size());
  crc32c = base::ExtendCrc32c(crc32c, rest.data(), rest.size());
  const std::string computed = absl::StrFormat("%08x", crc32c);
  if (stored != computed) {
    return absl::DataLossError(
        absl::StrFormat("%s: crc32c \"%s\" stored, \"%s\" computed", where, stored, computed));
  }
  return crc32c;
}

}  // namespace isoscope::store
