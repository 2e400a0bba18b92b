// Addresses of callers, as limits count them, and the proxies that name them.

#ifndef ISOSCOPE_CORE_HTTP_PEER_ADDRESS_H_
#define ISOSCOPE_CORE_HTTP_PEER_ADDRESS_H_

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace isoscope::http {

// Returns what counts as one address: an address of IPv4; of IPv6, where a host may use any of
// 2^64, the first 64 bits, "2001:db8:1:2::/64". An address of IPv4 in IPv6 ("::ffff:192.0.2.7")
// counts as that of IPv4. A text that is no address is returned as it is.
std::string PeerKey(absl::string_view address);

// Proxies whose word counts about the address of a caller. Thread-compatible.
class TrustedProxies {
 public:
  // "192.0.2.7", "10.0.0.0/8" or "2001:db8::/32". INVALID_ARGUMENT says what is allowed.
  absl::Status Add(absl::string_view text);

  [[nodiscard]] bool Contains(absl::string_view address) const;
  // Returns the address of the caller: `peer`, of the connection; if that is a proxy, the last one
  // of `forwarded_for` that is none. The list grows at its end, so whatever stands before that one
  // may be the caller's own invention. A part that is no address ends the search.
  //
  // forwarded_for: the values of all X-Forwarded-For, with commas between
  [[nodiscard]] std::string CallerOf(absl::string_view peer, absl::string_view forwarded_for) const;

 private:
  struct Network {
    std::array<std::uint8_t, 16> bytes;  // IPv6; IPv4 as ::ffff:a.b.c.d
    int prefix_bits = 0;                 // of those 128
  };

  std::vector<Network> networks_;
};

}  // namespace isoscope::http

#endif  // ISOSCOPE_CORE_HTTP_PEER_ADDRESS_H_
