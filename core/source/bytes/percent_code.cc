#include "core/source/bytes/percent_code.h"

#include <cstddef>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"

namespace isoscope::source {
namespace {

// REQUIRES: text[at] is '%'.
bool BeginsCode(absl::string_view text, std::size_t at) {
  return at + 2 < text.size() && absl::ascii_isxdigit(static_cast<unsigned char>(text[at + 1])) &&
         absl::ascii_isxdigit(static_cast<unsigned char>(text[at + 2]));
}

}  // namespace

bool IsPercentEncoded(absl::string_view text) {
  for (std::size_t at = text.find('%'); at != absl::string_view::npos;
       at = text.find('%', at + 1)) {
    if (!BeginsCode(text, at)) {
      return false;
    }
  }
  return true;
}

std::string PercentDecode(absl::string_view text) {
  std::string decoded;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '%' && BeginsCode(text, i)) {
      decoded += absl::HexStringToBytes(text.substr(i + 1, 2));
      i += 2;
    } else {
      decoded.push_back(text[i]);
    }
  }
  return decoded;
}

}  // namespace isoscope::source
