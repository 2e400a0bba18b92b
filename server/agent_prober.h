// Asking agents what they serve: a DescribeShards call to each, all at the same time.

#ifndef ISOSCOPE_SERVER_AGENT_PROBER_H_
#define ISOSCOPE_SERVER_AGENT_PROBER_H_

#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "absl/types/span.h"
#include <grpcpp/channel.h>

#include "core/base/cancellation.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"

namespace isoscope::server {

// One agent to ask, and its answer.
struct AgentProbe {
  std::string address;
  // The channel to ask over. Null: a fresh one, which dials at once and which is left here.
  std::shared_ptr<grpc::Channel> channel;
  absl::StatusOr<isoscope::internal::v1::DescribeShardsResponse> answer =
      absl::UnavailableError("not asked");
};

// How long an agent may take to answer.
inline constexpr absl::Duration kProbeTimeout = absl::Seconds(1);

// Asks all of them and waits for all answers: an agent that does not answer within kProbeTimeout,
// or before `cancellation` fires, has that as its error.
void ProbeAgents(absl::Span<AgentProbe> probes, const base::Cancellation& cancellation);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_AGENT_PROBER_H_
