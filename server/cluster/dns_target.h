// Agent targets that are names in the DNS. "dns:///NAME[:PORT]" stands for an agent at every
// address of the name. gRPC would use only one of the addresses, so this file resolves them.

#ifndef ISOSCOPE_SERVER_CLUSTER_DNS_TARGET_H_
#define ISOSCOPE_SERVER_CLUSTER_DNS_TARGET_H_

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

// Returns the name in "dns:///host:port"; the port of "dns:///host" is the default port of agents.
// Returns none for a target of another scheme, which gRPC dials as it is. INVALID_ARGUMENT: an
// empty target, or a malformed name.
absl::StatusOr<std::optional<DnsName>> ParseDnsTarget(absl::string_view target);

// Returns all addresses of a name, as gRPC dials them, ascending. UNAVAILABLE if it fails. Blocks.
absl::StatusOr<std::vector<std::string>> ResolveAddresses(const DnsName& name);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_CLUSTER_DNS_TARGET_H_
