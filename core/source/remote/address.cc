// Parsing, in this order, so that an error never repeats a secret:
//
// 1. The scheme; another one than http, https and s3 is refused.
// 2. Of HTTP: the fragment is refused, the query cut off, then the authority up to the first '/':
//    user names are refused, host and port checked byte by byte.
// 3. The path: bytes that no URL has are encoded, what is encoded stays. Parts "." and ".." are
//    refused, encoded ones ("%2e%2e"), too.
//
// Source: RFC 3986. libcurl gets only what passed here.

#include "core/source/remote/address.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"

#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/source/bytes/percent_code.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kMaxAddressBytes = 8192;  // signed addresses have some 2000
constexpr std::size_t kMaxHostBytes = 253;      // DNS
// Longer values of a query are no words: tokens, signatures.
constexpr std::size_t kMaxShownValueBytes = 40;

bool IsUnreserved(char c) {
  return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '.' || c == '_' ||
         c == '~';
}

// Encodes the bytes that no path or query has, and keeps %XX. Nothing if a '%' begins no %XX.
std::optional<std::string> EncodeMissing(absl::string_view text) {
  if (!IsPercentEncoded(text)) {
    return std::nullopt;
  }
  std::string encoded;
  for (const char c : text) {
    if (IsUnreserved(c) || absl::StrContains("%/!$&'()*+,;=:@?[]", c)) {
      encoded.push_back(c);
    } else {
      absl::StrAppendFormat(&encoded, "%%%02X", static_cast<unsigned char>(c));
    }
  }
  return encoded;
}

absl::Status Refuse(absl::string_view address, absl::string_view reason) {
  return absl::InvalidArgumentError(
      absl::StrCat("the address ", base::Quoted(RedactAddress(address)), ": ", reason));
}

bool HasDotPart(absl::string_view decoded_path) {
  for (const absl::string_view part : absl::StrSplit(decoded_path, '/')) {
    if (part == "." || part == "..") {
      return true;
    }
  }
  return false;
}

bool IsHost(absl::string_view host) {
  if (absl::StartsWith(host, "[")) {
    return host.size() > 2 && host.size() <= 47 && absl::EndsWith(host, "]") &&
           std::all_of(host.begin() + 1, host.end() - 1, [](char c) {
             return absl::ascii_isxdigit(static_cast<unsigned char>(c)) || c == ':' || c == '.';
           });
  }
  return !host.empty() && host.size() <= kMaxHostBytes &&
         std::all_of(host.begin(), host.end(), [](char c) {
           return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '.' ||
                  c == '_';
         });
}

// "host", "host:80", "[::1]:80".
absl::Status ParseAuthority(absl::string_view authority, absl::string_view text, Address* address) {
  if (absl::StrContains(authority, '@')) {
    return Refuse(text,
                  "has a user name or a password, which others could read; expected none: use a "
                  "netrc file or a token file");
  }
  absl::string_view host = authority;
  const std::size_t port_colon = authority.find(
      ':', absl::StartsWith(authority, "[") ? std::min(authority.find(']'), authority.size()) : 0);
  address->port = address->is_https ? 443 : 80;
  if (port_colon != absl::string_view::npos) {
    host = authority.substr(0, port_colon);
    const absl::string_view port = authority.substr(port_colon + 1);
    if (port.empty() || port.size() > 5 ||
        !std::all_of(port.begin(), port.end(),
                     [](char c) { return absl::ascii_isdigit(static_cast<unsigned char>(c)); }) ||
        !absl::SimpleAtoi(port, &address->port) || address->port < 1 || address->port > 65535) {
      return Refuse(text, "has another port than 1 to 65535");
    }
  }
  if (!IsHost(host)) {
    return Refuse(text, "has no host name, or one with other letters than A-Z a-z 0-9 - . _");
  }
  address->host = absl::AsciiStrToLower(host);
  return absl::OkStatus();
}

absl::StatusOr<Address> ParseHttp(absl::string_view rest, absl::string_view text, bool is_https) {
  Address address{.is_https = is_https};
  if (absl::StrContains(rest, '#')) {
    return Refuse(text, "has a fragment, '#...'; expected none; a '#' of a file's name is %23");
  }
  const std::size_t question = rest.find('?');
  if (question != absl::string_view::npos) {
    const auto query = EncodeMissing(rest.substr(question + 1));
    if (!query) {
      return Refuse(text, "has a '%' in its query that begins no %XX");
    }
    address.query = *query;
    rest = rest.substr(0, question);
  }
  const std::size_t slash = std::min(rest.find('/'), rest.size());
  ISOSCOPE_RETURN_IF_ERROR(ParseAuthority(rest.substr(0, slash), text, &address));
  const auto path = EncodeMissing(rest.substr(slash));
  if (!path) {
    return Refuse(text, "has a '%' in its path that begins no %XX; a '%' of a file's name is %25");
  }
  const std::string decoded = PercentDecode(*path);
  if (HasDotPart(decoded)) {
    return Refuse(text, "has the part \".\" or \"..\"; expected names only");
  }
  if (std::any_of(decoded.begin(), decoded.end(),
                  [](char c) { return absl::ascii_iscntrl(static_cast<unsigned char>(c)); })) {
    return Refuse(text, "has an encoded control character");
  }
  address.path = path->empty() ? "/" : *path;
  return address;
}

absl::StatusOr<Address> ParseS3(absl::string_view rest, absl::string_view text) {
  const std::size_t slash = std::min(rest.find('/'), rest.size());
  Address address{.is_s3 = true, .bucket = std::string(rest.substr(0, slash))};
  const std::string& bucket = address.bucket;
  if (bucket.size() < 3 || bucket.size() > 63 || absl::StrContains(bucket, "..") ||
      !std::all_of(bucket.begin(), bucket.end(), [](char c) {
        return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '.' ||
               c == '_';
      })) {
    return Refuse(text, "has no bucket of 3 to 63 letters A-Z a-z 0-9 - . _ behind s3://");
  }
  address.key = std::string(rest.substr(std::min(slash + 1, rest.size())));
  if (HasDotPart(address.key)) {
    return Refuse(text, "has the part \".\" or \"..\"; expected names only");
  }
  return address;
}

bool LooksSecret(absl::string_view name, absl::string_view value) {
  if (value.size() > kMaxShownValueBytes) {
    return true;
  }
  const std::string lower = absl::AsciiStrToLower(name);
  constexpr std::array<absl::string_view, 14> kWords = {
      "sig",  "token", "key",    "secret", "pass", "pwd",    "auth",
      "cred", "code",  "policy", "sess",   "jwt",  "ticket", "user"};
  return absl::StartsWith(lower, "x-") ||
         std::any_of(kWords.begin(), kWords.end(),
                     [&](absl::string_view word) { return absl::StrContains(lower, word); });
}

std::string RedactQuery(absl::string_view query) {
  std::vector<std::string> shown;
  for (const absl::string_view parameter : absl::StrSplit(query, '&')) {
    const std::size_t equals = parameter.find('=');
    if (equals == absl::string_view::npos) {
      // A parameter without '=' may be a token as a whole.
      shown.push_back(parameter.size() > 16 || LooksSecret(parameter, "") ? "..."
                                                                          : std::string(parameter));
      continue;
    }
    const absl::string_view name = parameter.substr(0, equals);
    const absl::string_view value = parameter.substr(equals + 1);
    shown.push_back(absl::StrCat(name.size() > kMaxShownValueBytes ? "..." : name, "=",
                                 LooksSecret(name, value) ? "..." : value));
  }
  return absl::StrJoin(shown, "&");
}

std::string HostAndPort(const Address& address) {
  return address.port == (address.is_https ? 443 : 80)
             ? address.host
             : absl::StrCat(address.host, ":", address.port);
}

}  // namespace

bool IsAddress(absl::string_view text) {
  const std::size_t colon = text.find("://");
  return colon != absl::string_view::npos && colon > 1 &&
         absl::ascii_isalpha(static_cast<unsigned char>(text[0])) &&
         std::all_of(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(colon), [](char c) {
           return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '+' || c == '-' ||
                  c == '.';
         });
}

absl::StatusOr<Address> ParseAddress(absl::string_view text) {
  if (text.size() > kMaxAddressBytes) {
    return Refuse(text,
                  absl::StrCat("has ", text.size(), " bytes; expected at most ", kMaxAddressBytes));
  }
  if (std::any_of(text.begin(), text.end(),
                  [](char c) { return absl::ascii_iscntrl(static_cast<unsigned char>(c)); })) {
    return Refuse(text, "has a control character");
  }
  if (!IsAddress(text)) {
    return Refuse(text, "has no scheme; expected https://, http:// or s3://");
  }
  const std::size_t colon = text.find("://");
  const std::string scheme = absl::AsciiStrToLower(text.substr(0, colon));
  const absl::string_view rest = text.substr(colon + 3);
  if (scheme == "http" || scheme == "https") {
    return ParseHttp(rest, text, scheme == "https");
  }
  if (scheme == "s3") {
    return ParseS3(rest, text);
  }
  return Refuse(text, scheme == "file" ? "names a local file; give its path instead"
                                       : "has an unknown scheme; expected https://, http:// or "
                                         "s3:// (others have addresses of https, too)");
}

absl::StatusOr<Address> ResolveLocation(const Address& from, absl::string_view location) {
  if (IsAddress(location)) {
    return ParseAddress(location);
  }
  if (absl::StartsWith(location, "//")) {
    return ParseAddress(absl::StrCat(from.is_https ? "https:" : "http:", location));
  }
  if (absl::StartsWith(location, "/")) {
    return ParseAddress(absl::StrCat(OriginOf(from), location));
  }
  if (absl::StartsWith(location, "?")) {
    return ParseAddress(absl::StrCat(OriginOf(from), from.path, location));
  }
  return ParseAddress(
      absl::StrCat(OriginOf(from), from.path.substr(0, from.path.rfind('/') + 1), location));
}

Address AddressBelow(const Address& prefix, absl::string_view key) {
  Address address = prefix;
  if (address.is_s3) {
    if (!address.key.empty() && !absl::EndsWith(address.key, "/")) {
      address.key.push_back('/');
    }
    absl::StrAppend(&address.key, key);
    return address;
  }
  if (!absl::EndsWith(address.path, "/")) {
    address.path.push_back('/');
  }
  absl::StrAppend(&address.path, PercentEncode(key, /*keeps_slashes=*/true));
  return address;
}

std::string NameOf(const Address& address) {
  if (address.is_s3) {
    return absl::StrCat("s3://", address.bucket, "/", address.key);
  }
  return absl::StrCat(OriginOf(address), address.path,
                      address.query.empty() ? "" : "?" + RedactQuery(address.query));
}

std::string RedactAddress(absl::string_view text) {
  const std::size_t colon = text.find("://");
  std::size_t begin = colon == absl::string_view::npos ? 0 : colon + 3;
  std::string redacted(text.substr(0, begin));
  absl::string_view rest = text.substr(begin);
  const bool is_s3 = absl::AsciiStrToLower(redacted) == "s3://";
  // A password may hold any byte: what stands before the last '@' is left out. A key of S3 may hold
  // an '@', too, behind a bucket that has no ':'.
  const std::size_t at = rest.rfind('@');
  const bool has_user = !is_s3 || absl::StrContains(rest.substr(0, rest.find('/')), ':') ||
                        absl::StrContains(rest.substr(0, rest.find('/')), '@');
  if (at != absl::string_view::npos && has_user) {
    absl::StrAppend(&redacted, "...");
    rest.remove_prefix(at);
  }
  if (is_s3) {
    return absl::StrCat(redacted, rest);
  }
  const std::size_t question = rest.find('?');
  absl::StrAppend(&redacted, rest.substr(0, question));
  if (question != absl::string_view::npos) {
    const absl::string_view query = rest.substr(question + 1);
    absl::StrAppend(&redacted, "?", RedactQuery(query.substr(0, query.find('#'))));
  }
  return redacted;
}

std::string OriginOf(const Address& address) {
  return absl::StrCat(address.is_https ? "https://" : "http://", HostAndPort(address));
}

std::string UrlOf(const Address& address) {
  return absl::StrCat(OriginOf(address), address.path,
                      address.query.empty() ? "" : absl::StrCat("?", address.query));
}

std::string LastPartOf(const Address& address) {
  const std::string path = address.is_s3 ? address.key : address.path;
  const std::string last = path.substr(path.rfind('/') + 1);
  return address.is_s3 ? last : PercentDecode(last);
}

std::string PercentEncode(absl::string_view bytes, bool keeps_slashes) {
  std::string encoded;
  for (const char c : bytes) {
    if (IsUnreserved(c) || (keeps_slashes && c == '/')) {
      encoded.push_back(c);
    } else {
      absl::StrAppendFormat(&encoded, "%%%02X", static_cast<unsigned char>(c));
    }
  }
  return encoded;
}

bool IsLoopback(absl::string_view host) {
  if (host == "localhost" || host == "[::1]") {
    return true;
  }
  const std::vector<absl::string_view> parts = absl::StrSplit(host, '.');
  return parts.size() == 4 && parts[0] == "127" &&
         std::all_of(parts.begin(), parts.end(), [](absl::string_view part) {
           return !part.empty() && part.size() <= 3 &&
                  std::all_of(part.begin(), part.end(), [](char c) {
                    return absl::ascii_isdigit(static_cast<unsigned char>(c));
                  });
         });
}

}  // namespace isoscope::source
