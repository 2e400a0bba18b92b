// Targets of agents that are names in the DNS: "dns:///NAME:PORT" stands for an agent at every
// address behind the name. gRPC would pick one of the addresses, so they are resolved here.

#ifndef ISOSCOPE_SERVER_DNS_TARGET_H_
#define ISOSCOPE_SERVER_DNS_TARGET_H_

#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::server {

struct DnsName {
  std::string host;
  std::string port;
};

// The name behind "dns:///host:port"; none for a target of another scheme, which gRPC dials as it
// is. INVALID_ARGUMENT: an empty target, or a malformed name.
absl::StatusOr<std::optional<DnsName>> ParseDnsTarget(absl::string_view target);

// All addresses behind a name, as gRPC dials them, ascending. UNAVAILABLE. Blocks.
absl::StatusOr<std::vector<std::string>> ResolveAddresses(const DnsName& name);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_DNS_TARGET_H_
