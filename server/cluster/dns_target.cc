#include "server/cluster/dns_target.h"

#include <netdb.h>

#include <cstddef>
#include <set>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include <netinet/in.h>
#include <sys/socket.h>

#include "rpc/host_port.h"

namespace isoscope::server {

absl::StatusOr<std::optional<DnsName>> ParseDnsTarget(absl::string_view target) {
  absl::string_view rest = target;
  if (rest.empty()) {
    return absl::InvalidArgumentError(
        "agent target is empty: must be HOST[:PORT] or any gRPC target");
  }
  if (!absl::ConsumePrefix(&rest, "dns:///")) {
    return std::nullopt;
  }
  const std::string address = rpc::WithDefaultPort(rest, rpc::kAgentPort);
  const std::size_t colon = address.rfind(':');
  absl::string_view host = absl::string_view(address).substr(0, colon);
  if (colon == std::string::npos || host.empty() || colon + 1 == address.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("agent target \"", target, "\": must be dns:///NAME[:PORT]"));
  }
  if (absl::ConsumePrefix(&host, "[")) {
    absl::ConsumeSuffix(&host, "]");
  }
  return DnsName{std::string(host), address.substr(colon + 1)};
}

absl::StatusOr<std::vector<std::string>> ResolveAddresses(const DnsName& name) {
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  const int error = getaddrinfo(name.host.c_str(), name.port.c_str(), &hints, &found);
  if (error != 0) {
    return absl::UnavailableError(
        absl::StrCat("can't resolve ", name.host, ":", name.port, ": ", gai_strerror(error)));
  }
  const auto free_found = absl::MakeCleanup([found] { freeaddrinfo(found); });
  std::set<std::string> addresses;
  for (const addrinfo* entry = found; entry != nullptr; entry = entry->ai_next) {
    char host[NI_MAXHOST];
    char port[NI_MAXSERV];
    if (getnameinfo(entry->ai_addr, entry->ai_addrlen, host, sizeof(host), port, sizeof(port),
                    NI_NUMERICHOST | NI_NUMERICSERV) == 0) {
      addresses.insert(entry->ai_family == AF_INET6 ? absl::StrCat("[", host, "]:", port)
                                                    : absl::StrCat(host, ":", port));
    }
  }
  return std::vector<std::string>(addresses.begin(), addresses.end());
}

}  // namespace isoscope::server
