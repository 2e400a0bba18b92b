#include "core/source/remote/sigv4.h"

#include <algorithm>
#include <array>
#include <cstddef>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/string_view.h"
#include <openssl/evp.h>
#include <openssl/hmac.h>

#include "core/base/check.h"
#include "core/base/sha256.h"
#include "core/source/remote/address.h"

namespace isoscope::source {
namespace {

std::string HmacSha256(absl::string_view key, absl::string_view text) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest;
  unsigned int size = 0;
  const unsigned char* const made =
      HMAC(EVP_sha256(), key.data(), static_cast<int>(key.size()),
           reinterpret_cast<const unsigned char*>(text.data()), text.size(), digest.data(), &size);
  ISOSCOPE_CHECK(made != nullptr);
  return {reinterpret_cast<const char*>(digest.data()), size};
}

// The headers as they are signed: lower-case names, sorted; values without spaces around them, and
// with one space in place of several.
std::vector<std::pair<std::string, std::string>> CanonicalHeaders(const RequestToSign& request) {
  std::vector<std::pair<std::string, std::string>> headers;
  headers.reserve(request.headers.size());
  for (const auto& [name, value] : request.headers) {
    std::string trimmed = value;
    absl::RemoveExtraAsciiWhitespace(&trimmed);
    headers.emplace_back(absl::AsciiStrToLower(name), std::move(trimmed));
  }
  std::sort(headers.begin(), headers.end());
  return headers;
}

std::string SignedNames(const std::vector<std::pair<std::string, std::string>>& headers) {
  return absl::StrJoin(headers, ";",
                       [](std::string* out, const auto& header) { out->append(header.first); });
}

}  // namespace

std::string CanonicalQuery(const std::vector<std::pair<std::string, std::string>>& query) {
  std::vector<std::pair<std::string, std::string>> encoded;
  encoded.reserve(query.size());
  for (const auto& [name, value] : query) {
    encoded.emplace_back(PercentEncode(name, /*keeps_slashes=*/false),
                         PercentEncode(value, /*keeps_slashes=*/false));
  }
  std::sort(encoded.begin(), encoded.end());
  return absl::StrJoin(encoded, "&", absl::PairFormatter("="));
}

std::string CanonicalRequest(const RequestToSign& request) {
  const auto headers = CanonicalHeaders(request);
  std::string text =
      absl::StrCat(request.method, "\n", request.path, "\n", CanonicalQuery(request.query), "\n");
  for (const auto& [name, value] : headers) {
    absl::StrAppend(&text, name, ":", value, "\n");
  }
  absl::StrAppend(&text, "\n", SignedNames(headers), "\n", request.payload_hash);
  return text;
}

Secret SignRequest(const RequestToSign& request, const SigningScope& scope,
                   const AwsCredentials& credentials) {
  ISOSCOPE_CHECK(scope.timestamp.size() == 16);
  const std::string day = scope.timestamp.substr(0, 8);
  const std::string scope_text =
      absl::StrCat(day, "/", scope.region, "/", scope.service, "/aws4_request");
  const std::string to_sign = absl::StrCat("AWS4-HMAC-SHA256\n", scope.timestamp, "\n", scope_text,
                                           "\n", base::Sha256Hex(CanonicalRequest(request)));
  std::string key = HmacSha256(absl::StrCat("AWS4", credentials.secret_access_key.Reveal()), day);
  key = HmacSha256(key, scope.region);
  key = HmacSha256(key, scope.service);
  key = HmacSha256(key, "aws4_request");
  return Secret(absl::StrCat("AWS4-HMAC-SHA256 Credential=", credentials.access_key_id, "/",
                             scope_text, ",SignedHeaders=", SignedNames(CanonicalHeaders(request)),
                             ",Signature=", absl::BytesToHexString(HmacSha256(key, to_sign))));
}

}  // namespace isoscope::source
