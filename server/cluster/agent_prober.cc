#include "server/cluster/agent_prober.h"

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "absl/synchronization/blocking_counter.h"
#include <grpcpp/client_context.h>

#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "isoscope/internal/v1/partition_agent_service.grpc.pb.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"
#include "rpc/unary_checksum.h"

namespace isoscope::server {
namespace {

namespace internal = isoscope::internal::v1;

struct Call {
  std::unique_ptr<internal::PartitionAgentService::Stub> stub;
  grpc::ClientContext context;
  internal::DescribeShardsRequest request;
  internal::DescribeShardsResponse response;
};

absl::StatusOr<internal::DescribeShardsResponse> AnswerOf(Call* call, const grpc::Status& status) {
  ISOSCOPE_RETURN_IF_ERROR(
      rpc::CheckAnswer(call->request, rpc::ToAbslStatus(status), call->response, call->context));
  return std::move(call->response);
}

}  // namespace

void ProbeAgents(absl::Span<AgentProbe> probes, const base::Cancellation& cancellation) {
  if (probes.empty()) {
    return;
  }
  const base::MonotonicTime deadline =
      std::min(base::MonotonicNow() + kProbeTimeout, cancellation.deadline());
  // This thread destroys the calls after they have ended. If a reaction dropped the last reference
  // to a channel instead, gRPC would join the reaction's own thread.
  std::vector<Call> calls(probes.size());
  absl::BlockingCounter unanswered(static_cast<int>(probes.size()));
  for (std::size_t i = 0; i < probes.size(); ++i) {
    AgentProbe& probe = probes[i];
    Call& call = calls[i];
    if (probe.channel == nullptr) {
      probe.channel = rpc::MakeAgentChannel(probe.address, probe.dialing);
      probe.export_channel = rpc::MakeExportChannel(probe.address, probe.dialing);
    }
    call.stub = internal::PartitionAgentService::NewStub(probe.channel);
    call.context.set_deadline(deadline);
    call.stub->async()->DescribeShards(&call.context, &call.request, &call.response,
                                       [&probe, &call, &unanswered](const grpc::Status& status) {
                                         probe.answer = AnswerOf(&call, status);
                                         unanswered.DecrementCount();
                                       });
  }
  const base::Cancellation::Callback cancel(cancellation, [&calls] {
    for (Call& call : calls) {
      call.context.TryCancel();
    }
  });
  unanswered.Wait();
}

}  // namespace isoscope::server
