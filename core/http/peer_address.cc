#include "core/http/peer_address.h"

#include <algorithm>
#include <cstddef>
#include <optional>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include <arpa/inet.h>
#include <netinet/in.h>

#include "core/base/printable.h"

namespace isoscope::http {
namespace {

using Bytes = std::array<std::uint8_t, 16>;

constexpr std::size_t kIpv4Offset = 12;  // in an address of IPv4 as IPv6
constexpr int kIpv4Bits = 8 * kIpv4Offset;
constexpr std::array<std::uint8_t, kIpv4Offset> kIpv4Prefix = {0, 0, 0, 0, 0,    0,
                                                               0, 0, 0, 0, 0xff, 0xff};

std::optional<Bytes> ParseAddress(absl::string_view text) {
  // inet_pton ends at a NUL.
  if (absl::StrContains(text, '\0')) {
    return std::nullopt;
  }
  const std::string address(text);
  Bytes bytes{};
  if (inet_pton(AF_INET6, address.c_str(), bytes.data()) == 1) {
    return bytes;
  }
  std::copy(kIpv4Prefix.begin(), kIpv4Prefix.end(), bytes.begin());
  if (inet_pton(AF_INET, address.c_str(), &bytes[kIpv4Offset]) == 1) {
    return bytes;
  }
  return std::nullopt;
}

bool IsIpv4(const Bytes& bytes) {
  return std::equal(kIpv4Prefix.begin(), kIpv4Prefix.end(), bytes.begin());
}

std::string TextOf(const Bytes& bytes) {
  std::array<char, INET6_ADDRSTRLEN> text{};
  const bool is_ipv4 = IsIpv4(bytes);
  inet_ntop(is_ipv4 ? AF_INET : AF_INET6, is_ipv4 ? &bytes[kIpv4Offset] : bytes.data(), text.data(),
            text.size());
  return text.data();
}

bool HasPrefix(const Bytes& bytes, const Bytes& prefix, int bits) {
  const auto whole = static_cast<std::size_t>(bits / 8);
  if (!std::equal(prefix.begin(), prefix.begin() + whole, bytes.begin())) {
    return false;
  }
  const auto mask = static_cast<unsigned>(0xff00 >> (bits % 8)) & 0xffU;
  return mask == 0 || (bytes[whole] & mask) == (prefix[whole] & mask);
}

// "192.0.2.7:4711" and "[2001:db8::1]:4711" without the port; some proxies write one.
absl::string_view WithoutPort(absl::string_view text) {
  if (absl::StartsWith(text, "[")) {
    const std::size_t end = text.find(']');
    return end == absl::string_view::npos ? text : text.substr(1, end - 1);
  }
  const std::size_t colon = text.find(':');
  const bool has_one = colon != absl::string_view::npos && text.rfind(':') == colon;
  return has_one ? text.substr(0, colon) : text;
}

}  // namespace

std::string PeerKey(absl::string_view address) {
  std::optional<Bytes> bytes = ParseAddress(address);
  if (!bytes.has_value()) {
    return std::string(address);
  }
  if (IsIpv4(*bytes)) {
    return TextOf(*bytes);
  }
  std::fill(bytes->begin() + bytes->size() / 2, bytes->end(), std::uint8_t{0});
  return absl::StrCat(TextOf(*bytes), "/64");
}

absl::Status TrustedProxies::Add(absl::string_view text) {
  const std::vector<absl::string_view> parts = absl::StrSplit(text, '/');
  const std::optional<Bytes> bytes = ParseAddress(parts[0]);
  const int max_bits =
      bytes.has_value() && IsIpv4(*bytes) && !absl::StrContains(parts[0], ':') ? 32 : 128;
  int bits = max_bits;
  if (!bytes.has_value() || parts.size() > 2 ||
      (parts.size() == 2 && (!absl::SimpleAtoi(parts[1], &bits) || bits < 0 || bits > max_bits))) {
    return absl::InvalidArgumentError(absl::StrCat(
        base::Quoted(text, '\''),
        " is not the address of a proxy: ADDRESS or ADDRESS/BITS in digits, such as 192.0.2.7, "
        "10.0.0.0/8 or 2001:db8::/32"));
  }
  networks_.push_back({.bytes = *bytes, .prefix_bits = max_bits == 32 ? kIpv4Bits + bits : bits});
  return absl::OkStatus();
}

bool TrustedProxies::Contains(absl::string_view address) const {
  const std::optional<Bytes> bytes = ParseAddress(address);
  return bytes.has_value() &&
         std::any_of(networks_.begin(), networks_.end(), [&](const Network& network) {
           return HasPrefix(*bytes, network.bytes, network.prefix_bits);
         });
}

std::string TrustedProxies::CallerOf(absl::string_view peer,
                                     absl::string_view forwarded_for) const {
  std::string caller(peer);
  const std::vector<absl::string_view> named = absl::StrSplit(forwarded_for, ',');
  for (auto part = named.rbegin(); part != named.rend() && Contains(caller); ++part) {
    const absl::string_view address = WithoutPort(absl::StripAsciiWhitespace(*part));
    if (!ParseAddress(address).has_value()) {
      break;
    }
    caller = std::string(address);
  }
  return caller;
}

}  // namespace isoscope::http
