// The members of a cluster: the agents that its endpoints name, by address.

#ifndef ISOSCOPE_SERVER_CLUSTER_AGENT_MEMBERS_H_
#define ISOSCOPE_SERVER_CLUSTER_AGENT_MEMBERS_H_

#include <cstddef>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "server/cluster/agent_endpoint.h"
#include "server/cluster/dataset_catalog.h"
#include "server/cluster/dns_target.h"

namespace isoscope::server {

// An agent, and the endpoint that named it.
struct AgentMember {
  AgentState state;
  std::size_t endpoint_index = 0;
  bool is_listed = true;  // its endpoint's name still has this address
  bool has_fixed_channel = false;
  bool is_name = false;  // a name without known addresses: no agent can be asked
};
using AgentMembers = std::map<std::string, AgentMember>;  // by address

// Makes members of endpoints. A plain target is one member. A name in the DNS is one member for
// each of its addresses, a list one for each of its targets. Thread-compatible.
class AgentMemberResolver {
 public:
  using CheckTarget = std::function<absl::Status(const std::string& target)>;
  using ResolveName = std::function<absl::StatusOr<std::vector<std::string>>(const DnsName&)>;

  // `endpoints` outlive the resolver; their targets can be parsed. Null `check_target`: lists may
  // name all targets; else an error refuses the whole list.
  AgentMemberResolver(const std::vector<AgentEndpoint>& endpoints, CheckTarget check_target,
                      ResolveName resolve)
      : endpoints_(endpoints),
        check_target_(std::move(check_target)),
        resolve_(std::move(resolve)) {}

  // Returns `members` with those added that the endpoints name now, and without those that a list
  // has lost. An address that a name in the DNS has lost stays, and is not listed. A name or list
  // that can't be read changes nothing; without known agents it is a member with that error. Blocks
  // on disk and `resolve`.
  AgentMembers Resolve(AgentMembers members);

 private:
  void ResolveList(std::size_t endpoint_index, const std::string& path, AgentMembers* members);
  void ResolveDns(std::size_t endpoint_index, const DnsName& name, AgentMembers* members) const;
  // Keeps the agents of an endpoint that can't be read now; without any its target has the error.
  void KeepKnown(std::size_t endpoint_index, const absl::Status& error,
                 AgentMembers* members) const;

  const std::vector<AgentEndpoint>& endpoints_;
  const CheckTarget check_target_;
  const ResolveName resolve_;
  std::map<std::string, absl::Status> list_errors_;  // the last of each list: each is logged once
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_CLUSTER_AGENT_MEMBERS_H_
