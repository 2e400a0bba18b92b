#include "web-gateway/etag.h"

#include <array>
#include <cstddef>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include <openssl/sha.h>

namespace isoscope::gateway {

std::string MakeEtag(const std::vector<absl::string_view>& parts) {
  std::string text;
  for (const absl::string_view part : parts) {
    absl::StrAppend(&text, part.size(), ":", part);
  }
  std::array<unsigned char, SHA256_DIGEST_LENGTH> digest{};
  SHA256(reinterpret_cast<const unsigned char*>(text.data()), text.size(), digest.data());
  constexpr std::size_t kTagBytes = 16;
  return absl::StrCat("\"",
                      absl::BytesToHexString(absl::string_view(
                          reinterpret_cast<const char*>(digest.data()), kTagBytes)),
                      "\"");
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
