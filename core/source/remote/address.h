// Addresses of objects:
//
//   https://host[:port]/path[?query]   http: too; the path may be percent-encoded
//   s3://BUCKET/KEY                    the key is taken as it is: no byte of it is encoded
//
// A user name or a password in an address is refused, as are parts "." and "..", so that an address
// that begins with a prefix leads below it. Values of a query may be secrets (a signature, a token),
// so that only NameOf and RedactAddress give text for messages.

#ifndef ISOSCOPE_CORE_SOURCE_REMOTE_ADDRESS_H_
#define ISOSCOPE_CORE_SOURCE_REMOTE_ADDRESS_H_

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::source {

// A value type.
struct Address {
  bool is_s3 = false;

  // Of HTTP:
  bool is_https = false;
  std::string host = {};   // lower case; of IPv6 in brackets
  int port = 0;            // 1 to 65535
  std::string path = {};   // percent-encoded; begins with '/'
  std::string query = {};  // percent-encoded, without the '?'; may hold secrets

  // Of S3:
  std::string bucket = {};
  std::string key = {};  // not encoded; may be empty: the whole bucket

  friend bool operator==(const Address&, const Address&) = default;
};

// Returns true for text that begins with a scheme, "http://", "s3://" or another: no path of a file.
bool IsAddress(absl::string_view text);

// INVALID_ARGUMENT names the fault and the address, without secrets.
absl::StatusOr<Address> ParseAddress(absl::string_view text);

// The address that a response of `from` redirects to: absolute, or relative to `from`.
// INVALID_ARGUMENT as ParseAddress.
absl::StatusOr<Address> ResolveLocation(const Address& from, absl::string_view location);

// The address of the object `key` below `prefix`. REQUIRES: CheckObjectKey(key).
Address AddressBelow(const Address& prefix, absl::string_view key);

// The address for messages: without secrets. Values of a query are left out if their name or their
// length looks like a secret's.
std::string NameOf(const Address& address);
// The same for any text that may be an address, a broken one, too.
std::string RedactAddress(absl::string_view text);

// "https://host:port", with the port where it is not the scheme's own.
std::string OriginOf(const Address& address);
// The whole address of HTTP, secrets included: for the request alone. REQUIRES: !is_s3.
std::string UrlOf(const Address& address);

// The last part of path or key, decoded: "head.nrrd". Empty if it ends in '/'.
std::string LastPartOf(const Address& address);

// RFC 3986, section 2.1: every byte but A-Z a-z 0-9 - . _ ~ (and '/' if `keeps_slashes`) becomes
// %XX, in capitals.
std::string PercentEncode(absl::string_view bytes, bool keeps_slashes);

// True for localhost, 127.0.0.0/8 and [::1], whose traffic does not leave the machine.
bool IsLoopback(absl::string_view host);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_REMOTE_ADDRESS_H_
