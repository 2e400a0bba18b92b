// Asks agents for their shards: makes a DescribeShards call to each, all at the same time.

#ifndef ISOSCOPE_SERVER_CLUSTER_AGENT_PROBER_H_
#define ISOSCOPE_SERVER_CLUSTER_AGENT_PROBER_H_

#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "absl/types/span.h"
#include <grpcpp/channel.h>

#include "core/base/cancellation.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "rpc/transport.h"

namespace isoscope::server {

// One agent to ask, and its answer.
struct AgentProbe {
  std::string address;
  // The channel to use. If it is null, ProbeAgents stores a fresh one here, which dials at once. It
  // also stores one for exports, which dials on first use.
  std::shared_ptr<grpc::Channel> channel;
  std::shared_ptr<grpc::Channel> export_channel = nullptr;
  rpc::Dialing dialing = {};  // of a fresh channel
  absl::StatusOr<isoscope::internal::v1::DescribeShardsResponse> answer =
      absl::UnavailableError("not asked");
};

// The longest time that an agent may take to answer.
inline constexpr absl::Duration kProbeTimeout = absl::Seconds(1);

// Asks all agents and waits for all answers. An agent that does not answer within kProbeTimeout, or
// before `cancellation` fires, gets DEADLINE_EXCEEDED or CANCELLED as its answer.
void ProbeAgents(absl::Span<AgentProbe> probes, const base::Cancellation& cancellation);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_CLUSTER_AGENT_PROBER_H_
