#include "server/cluster/agent_members.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "core/base/log.h"
#include "server/cluster/agent_list.h"

namespace isoscope::server {
namespace {

AgentMember& AddMember(const std::string& address, std::size_t endpoint_index,
                       AgentMembers* members) {
  AgentMember& member = (*members)[address];
  member.endpoint_index = endpoint_index;
  member.state.address = address;
  return member;
}

}  // namespace

AgentMembers AgentMemberResolver::Resolve(AgentMembers members) {
  for (std::size_t i = 0; i < endpoints_.size(); ++i) {
    const AgentEndpoint& endpoint = endpoints_[i];
    const auto list = ParseAgentListTarget(endpoint.target);
    const auto name = ParseDnsTarget(endpoint.target);
    if (list.ok() && list->has_value()) {
      ResolveList(i, **list, &members);
    } else if (endpoint.channel != nullptr) {
      AgentMember& member = AddMember(endpoint.target, i, &members);
      member.state.channel = endpoint.channel;
      member.has_fixed_channel = true;
    } else if (name.ok() && name->has_value()) {
      ResolveDns(i, **name, &members);
    } else {
      AddMember(endpoint.target, i, &members);
    }
  }
  return members;
}

void AgentMemberResolver::ResolveList(std::size_t endpoint_index, const std::string& path,
                                      AgentMembers* members) {
  absl::StatusOr<std::vector<std::string>> targets = ReadAgentList(path);
  for (std::size_t i = 0; targets.ok() && check_target_ && i < targets->size(); ++i) {
    if (absl::Status status = check_target_((*targets)[i]); !status.ok()) {
      targets = std::move(status);
    }
  }
  if (list_errors_[path] != targets.status()) {
    list_errors_[path] = targets.status();
    base::Log(targets.ok() ? base::LogLevel::kInfo : base::LogLevel::kWarning,
              targets.ok() ? "agent_list_read" : "agent_list_not_read",
              {{"file", path}, {"status", targets.status()}});
  }
  if (!targets.ok()) {
    KeepKnown(endpoint_index, targets.status(), members);
    return;
  }
  std::erase_if(*members, [&](const auto& entry) {
    return entry.second.endpoint_index == endpoint_index &&
           !std::binary_search(targets->begin(), targets->end(), entry.first);
  });
  for (const std::string& address : *targets) {
    AddMember(address, endpoint_index, members);
  }
}

void AgentMemberResolver::ResolveDns(std::size_t endpoint_index, const DnsName& name,
                                     AgentMembers* members) const {
  const absl::StatusOr<std::vector<std::string>> addresses = resolve_(name);
  if (!addresses.ok()) {
    // A failure of the resolver says nothing about agents, so the known ones stay.
    KeepKnown(endpoint_index, addresses.status(), members);
    return;
  }
  members->erase(endpoints_[endpoint_index].target);
  for (auto& [address, member] : *members) {
    if (member.endpoint_index == endpoint_index) {
      member.is_listed = false;
    }
  }
  for (const std::string& address : *addresses) {
    AddMember(address, endpoint_index, members).is_listed = true;
  }
}

void AgentMemberResolver::KeepKnown(std::size_t endpoint_index, const absl::Status& error,
                                    AgentMembers* members) const {
  const std::string& target = endpoints_[endpoint_index].target;
  const bool is_known = std::any_of(members->begin(), members->end(), [&](const auto& entry) {
    return entry.second.endpoint_index == endpoint_index && entry.first != target;
  });
  if (!is_known) {
    AgentMember& member = AddMember(target, endpoint_index, members);
    member.state.status = error;
    member.is_name = true;
  }
}

}  // namespace isoscope::server
