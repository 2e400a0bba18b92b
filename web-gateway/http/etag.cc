#include "web-gateway/http/etag.h"

#include <cstddef>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"

#include "core/base/sha256.h"

namespace isoscope::gateway {

std::string MakeEtag(const std::vector<absl::string_view>& parts) {
  std::string text;
  for (const absl::string_view part : parts) {
    absl::StrAppend(&text, part.size(), ":", part);
  }
  constexpr std::size_t kTagDigits = 32;
  return absl::StrCat("\"", base::Sha256Hex(text).substr(0, kTagDigits), "\"");
}

bool MatchesEtag(absl::string_view if_none_match, absl::string_view etag) {
  for (absl::string_view tag : absl::StrSplit(if_none_match, ',')) {
    tag = absl::StripAsciiWhitespace(tag);
    if (tag == "*" || absl::StripPrefix(tag, "W/") == etag) {
      return true;
    }
  }
  return false;
}

}  // namespace isoscope::gateway
