#include "server/agent_queries.h"

#include <cstddef>
#include <memory>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/synchronization/blocking_counter.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include <grpcpp/client_context.h>

#include "core/rpc/grpc_status.h"
#include "core/rpc/pick_convert.h"
#include "core/rpc/proto_convert.h"
#include "core/rpc/request_context.h"
#include "isoscope/internal/v1/partition_agent_service.grpc.pb.h"
#include "server/agent_client.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::internal::v1;

// One call to one agent.
template <typename Request, typename Response>
struct Call {
  std::unique_ptr<v1::PartitionAgentService::Stub> stub;
  grpc::ClientContext context;
  Request request;
  Response response;
  absl::Status status;
};

template <typename Request, typename Response>
using Calls = std::vector<Call<Request, Response>>;

// Starts all calls with `start(call, on_done)` and waits for their ends. `calls`: one for each of
// the dataset's first agents, with its request.
template <typename Request, typename Response, typename Start>
void RunCalls(const DatasetState& dataset, const base::TraceContext& identity,
              const base::Cancellation& cancellation, Calls<Request, Response>* calls,
              const Start& start) {
  absl::BlockingCounter unanswered(static_cast<int>(calls->size()));
  for (std::size_t i = 0; i < calls->size(); ++i) {
    Call<Request, Response>& call = (*calls)[i];
    call.stub = v1::PartitionAgentService::NewStub(dataset.agents[i].channel);
    if (cancellation.deadline() != absl::InfiniteFuture()) {
      call.context.set_deadline(absl::ToChronoTime(cancellation.deadline()));
    }
    rpc::SetTraceparent(identity, &call.context);
    start(&call, [&call, &unanswered](const grpc::Status& status) {
      call.status = rpc::ToAbslStatus(status);
      unanswered.DecrementCount();
    });
  }
  const base::Cancellation::Callback cancel(cancellation, [calls] {
    for (Call<Request, Response>& call : *calls) {
      call.context.TryCancel();
    }
  });
  unanswered.Wait();
}

// The failures of calls; INVALID_ARGUMENT, which the client's request caused, stays what it is.
template <typename Request, typename Response>
std::vector<AgentFailure> FailuresOf(const DatasetState& dataset,
                                     const Calls<Request, Response>& calls,
                                     const base::Cancellation& cancellation) {
  std::vector<AgentFailure> failures;
  for (std::size_t i = 0; i < calls.size(); ++i) {
    const absl::Status& status = calls[i].status;
    if (!status.ok()) {
      failures.push_back({.agent_index = i,
                          .agent = dataset.agents[i].identity(),
                          .stage = FrameStage::kSelectingOccluders,
                          .status = absl::IsInvalidArgument(status)
                                        ? status
                                        : CallStatus(status, cancellation.is_cancelled())});
    }
  }
  return failures;
}

// The error for the client: the caller's own end first, then the first agent's.
absl::Status ErrorOf(const std::vector<AgentFailure>& failures,
                     const base::Cancellation& cancellation) {
  if (cancellation.is_cancelled()) {
    return absl::CancelledError("cancelled by the caller");
  }
  const AgentFailure& first = failures.front();
  return absl::IsInvalidArgument(first.status) ? first.status : first.ToStatus();
}

AgentFailure Malformed(const DatasetState& dataset, std::size_t i, const absl::Status& status) {
  return {
      .agent_index = i,
      .agent = dataset.agents[i].identity(),
      .stage = FrameStage::kSelectingOccluders,
      .status = absl::InternalError(absl::StrCat("sent a malformed answer: ", status.message()))};
}

}  // namespace

QueryOutcome<volume::HistogramPart> AskHistogram(const DatasetState& dataset,
                                                 const rpc::HistogramQuery& query,
                                                 const base::TraceContext& identity,
                                                 const base::Cancellation& cancellation) {
  Calls<v1::GetShardHistogramRequest, v1::GetShardHistogramResponse> calls(dataset.agents.size());
  for (std::size_t i = 0; i < calls.size(); ++i) {
    v1::GetShardHistogramRequest& request = calls[i].request;
    request.set_dataset_id(dataset.dataset.dataset_id());
    for (const int shard : dataset.agents[i].shard_indices) {
      request.add_shard_indices(shard);
    }
    request.set_max_bin_count(static_cast<std::int32_t>(query.max_bin_count));
    if (query.value_range.has_value()) {
      request.mutable_value_range()->set_min(query.value_range->min);
      request.mutable_value_range()->set_max(query.value_range->max);
    }
  }
  RunCalls(dataset, identity, cancellation, &calls, [](auto* call, auto on_done) {
    call->stub->async()->GetShardHistogram(&call->context, &call->request, &call->response,
                                           std::move(on_done));
  });
  std::vector<AgentFailure> failures = FailuresOf(dataset, calls, cancellation);
  if (!failures.empty()) {
    absl::Status error = ErrorOf(failures, cancellation);
    return {std::move(error), std::move(failures)};
  }
  std::optional<volume::HistogramPart> whole;
  for (std::size_t i = 0; i < calls.size(); ++i) {
    absl::StatusOr<volume::HistogramPart> part = rpc::HistogramPartFromProto(calls[i].response);
    absl::Status status = part.status();
    if (status.ok() && whole.has_value()) {
      status = volume::AddPart(*part, &*whole);
    }
    if (!status.ok()) {
      AgentFailure failure = Malformed(dataset, i, status);
      return {failure.ToStatus(), {failure}};
    }
    if (!whole.has_value()) {
      whole = *std::move(part);
    }
  }
  return {*std::move(whole), {}};
}

QueryOutcome<std::optional<math::IndexBox>> AskActiveBox(const DatasetState& dataset,
                                                         const volume::BlockLayout& layout,
                                                         const std::vector<double>& isovalues,
                                                         const isoscope::v1::ClipRegion& clip,
                                                         const base::TraceContext& identity,
                                                         const base::Cancellation& cancellation) {
  Calls<v1::GetActiveBoxRequest, v1::GetActiveBoxResponse> calls(1);
  calls[0].request.set_dataset_id(dataset.dataset.dataset_id());
  for (const double isovalue : isovalues) {
    calls[0].request.add_isovalues(isovalue);
  }
  *calls[0].request.mutable_clip() = clip;
  RunCalls(dataset, identity, cancellation, &calls, [](auto* call, auto on_done) {
    call->stub->async()->GetActiveBox(&call->context, &call->request, &call->response,
                                      std::move(on_done));
  });
  std::vector<AgentFailure> failures = FailuresOf(dataset, calls, cancellation);
  if (!failures.empty()) {
    absl::Status error = ErrorOf(failures, cancellation);
    return {std::move(error), std::move(failures)};
  }
  absl::StatusOr<std::optional<math::IndexBox>> box =
      rpc::ActiveBoxFromProto(calls[0].response, layout);
  if (!box.ok()) {
    AgentFailure failure = Malformed(dataset, 0, box.status());
    return {failure.ToStatus(), {failure}};
  }
  return {*std::move(box), {}};
}

QueryOutcome<std::vector<std::optional<math::Vec3d>>> AskGradients(
    const DatasetState& dataset, const std::vector<math::Vec3d>& points,
    const base::TraceContext& identity, const base::Cancellation& cancellation) {
  Calls<v1::GetGradientsRequest, v1::GetGradientsResponse> calls(dataset.agents.size());
  for (std::size_t i = 0; i < calls.size(); ++i) {
    v1::GetGradientsRequest& request = calls[i].request;
    request.set_dataset_id(dataset.dataset.dataset_id());
    for (const int shard : dataset.agents[i].shard_indices) {
      request.add_shard_indices(shard);
    }
    for (const math::Vec3d& point : points) {
      *request.add_points() = rpc::ToProto(point);
    }
  }
  RunCalls(dataset, identity, cancellation, &calls, [](auto* call, auto on_done) {
    call->stub->async()->GetGradients(&call->context, &call->request, &call->response,
                                      std::move(on_done));
  });
  std::vector<AgentFailure> failures = FailuresOf(dataset, calls, cancellation);
  if (!failures.empty()) {
    absl::Status error = ErrorOf(failures, cancellation);
    return {std::move(error), std::move(failures)};
  }
  std::vector<std::optional<math::Vec3d>> gradients(points.size());
  for (std::size_t i = 0; i < calls.size(); ++i) {
    const absl::Status status = rpc::AddGradients(calls[i].response, &gradients);
    if (!status.ok()) {
      AgentFailure failure = Malformed(dataset, i, status);
      return {failure.ToStatus(), {failure}};
    }
  }
  return {std::move(gradients), {}};
}

}  // namespace isoscope::server
