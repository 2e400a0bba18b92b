#include "server/frame/agent_queries.h"

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <memory>
#include <numeric>
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
#include "core/rpc/unary_checksum.h"
#include "isoscope/internal/v1/partition_agent_service.grpc.pb.h"
#include "server/frame/agent_client.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::internal::v1;

// One call to one agent.
template <typename Request, typename Response>
struct Call {
  std::unique_ptr<v1::PartitionAgentService::Stub> stub;
  std::unique_ptr<grpc::ClientContext> context;
  Request request;
  Response response;
  absl::Status status;
  std::size_t replica = 0;  // the last one that was asked
};

// One for each of the first parts.
template <typename Request, typename Response>
using Calls = std::vector<Call<Request, Response>>;

// The failure of a call; INVALID_ARGUMENT, which the client's request caused, stays what it is.
AgentFailure FailureOf(const FramePart& part, std::size_t part_index, std::size_t replica,
                       const absl::Status& status, const base::Cancellation& cancellation) {
  return {.part_index = part_index,
          .agent = part.On(replica).identity(),
          .stage = FrameStage::kSelectingOccluders,
          .status = absl::IsInvalidArgument(status)
                        ? status
                        : CallStatus(status, cancellation.is_cancelled())};
}

// Starts the calls of some parts on their replicas of that index with `start(call, on_done)`, and
// waits for their ends.
template <typename Request, typename Response, typename Start>
void RunRound(const QueryTarget& target, const std::vector<std::size_t>& open, std::size_t replica,
              const base::TraceContext& identity, const base::Cancellation& cancellation,
              const Start& start, Calls<Request, Response>* calls) {
  absl::BlockingCounter unanswered(static_cast<int>(open.size()));
  for (const std::size_t i : open) {
    Call<Request, Response>& call = (*calls)[i];
    call.stub = v1::PartitionAgentService::NewStub(target.parts[i].replicas[replica].channel);
    call.context = std::make_unique<grpc::ClientContext>();
    call.response.Clear();
    call.replica = replica;
    if (cancellation.deadline() != absl::InfiniteFuture()) {
      call.context->set_deadline(absl::ToChronoTime(cancellation.deadline()));
    }
    rpc::SetTraceparent(identity, call.context.get());
    start(&call, [&call, &unanswered](const grpc::Status& status) {
      call.status =
          rpc::CheckAnswer(call.request, rpc::ToAbslStatus(status), call.response, *call.context);
      unanswered.DecrementCount();
    });
  }
  const base::Cancellation::Callback cancel(cancellation, [&] {
    for (const std::size_t i : open) {
      (*calls)[i].context->TryCancel();
    }
  });
  unanswered.Wait();
}

// Makes all calls, and returns the agents that failed. Those that no replica could stand in for
// come last, and their calls have an error.
template <typename Request, typename Response, typename Start>
std::vector<AgentFailure> RunCalls(const QueryTarget& target, const base::TraceContext& identity,
                                   const base::Cancellation& cancellation, const Start& start,
                                   Calls<Request, Response>* calls) {
  std::vector<AgentFailure> stood_in_for;
  std::vector<AgentFailure> failures;
  std::vector<std::size_t> open(calls->size());
  std::iota(open.begin(), open.end(), std::size_t{0});
  for (std::size_t replica = 0; !open.empty(); ++replica) {
    RunRound(target, open, replica, identity, cancellation, start, calls);
    std::vector<std::size_t> again;
    for (const std::size_t i : open) {
      const absl::Status& status = (*calls)[i].status;
      if (status.ok()) {
        continue;
      }
      const bool is_repeatable = !cancellation.is_cancelled() && !absl::IsInvalidArgument(status) &&
                                 !absl::IsDeadlineExceeded(status);
      const bool has_other = replica + 1 < target.parts[i].replicas.size();
      (is_repeatable && has_other ? stood_in_for : failures)
          .push_back(FailureOf(target.parts[i], i, replica, status, cancellation));
      if (is_repeatable && has_other) {
        again.push_back(i);
      }
    }
    open = std::move(again);
  }
  std::move(failures.begin(), failures.end(), std::back_inserter(stood_in_for));
  return stood_in_for;
}

template <typename Request, typename Response>
bool AllAnswered(const Calls<Request, Response>& calls) {
  return std::all_of(calls.begin(), calls.end(), [](const auto& call) { return call.status.ok(); });
}

// The error for the client: the caller's own end first, then an agent's that nobody stood in for.
absl::Status ErrorOf(const std::vector<AgentFailure>& failures,
                     const base::Cancellation& cancellation) {
  if (cancellation.is_cancelled()) {
    return absl::CancelledError("cancelled by the caller");
  }
  const AgentFailure& last = failures.back();
  return absl::IsInvalidArgument(last.status) ? last.status : last.ToStatus();
}

AgentFailure Malformed(const QueryTarget& target, std::size_t i, std::size_t replica,
                       const absl::Status& status) {
  return {
      .part_index = i,
      .agent = target.parts[i].On(replica).identity(),
      .stage = FrameStage::kSelectingOccluders,
      .status = absl::InternalError(absl::StrCat("sent a malformed answer: ", status.message()))};
}

}  // namespace

QueryOutcome<volume::HistogramPart> AskHistogram(const QueryTarget& target,
                                                 const rpc::HistogramQuery& query,
                                                 const base::TraceContext& identity,
                                                 const base::Cancellation& cancellation) {
  Calls<v1::GetShardHistogramRequest, v1::GetShardHistogramResponse> calls(target.parts.size());
  for (std::size_t i = 0; i < calls.size(); ++i) {
    v1::GetShardHistogramRequest& request = calls[i].request;
    request.set_dataset_id(target.dataset_id);
    for (const int shard : target.parts[i].shard_indices) {
      request.add_shard_indices(shard);
    }
    request.set_max_bin_count(static_cast<std::int32_t>(query.max_bin_count));
    if (query.value_range.has_value()) {
      request.mutable_value_range()->set_min(query.value_range->min);
      request.mutable_value_range()->set_max(query.value_range->max);
    }
  }
  std::vector<AgentFailure> failures = RunCalls(
      target, identity, cancellation,
      [](auto* call, auto on_done) {
        call->stub->async()->GetShardHistogram(call->context.get(), &call->request, &call->response,
                                               std::move(on_done));
      },
      &calls);
  if (!AllAnswered(calls)) {
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
      AgentFailure failure = Malformed(target, i, calls[i].replica, status);
      return {failure.ToStatus(), {failure}};
    }
    if (!whole.has_value()) {
      whole = *std::move(part);
    }
  }
  return {*std::move(whole), std::move(failures)};
}

QueryOutcome<ActiveExtent> AskActiveBox(const QueryTarget& target,
                                        const volume::BlockLayout& layout,
                                        const std::vector<double>& isovalues,
                                        const isoscope::v1::ClipRegion& clip,
                                        const base::TraceContext& identity,
                                        const base::Cancellation& cancellation) {
  Calls<v1::GetActiveBoxRequest, v1::GetActiveBoxResponse> calls(1);
  calls[0].request.set_dataset_id(target.dataset_id);
  for (const double isovalue : isovalues) {
    calls[0].request.add_isovalues(isovalue);
  }
  *calls[0].request.mutable_clip() = clip;
  std::vector<AgentFailure> failures = RunCalls(
      target, identity, cancellation,
      [](auto* call, auto on_done) {
        call->stub->async()->GetActiveBox(call->context.get(), &call->request, &call->response,
                                          std::move(on_done));
      },
      &calls);
  if (!AllAnswered(calls)) {
    absl::Status error = ErrorOf(failures, cancellation);
    return {std::move(error), std::move(failures)};
  }
  absl::StatusOr<std::optional<math::IndexBox>> box =
      rpc::ActiveBoxFromProto(calls[0].response, layout);
  if (!box.ok()) {
    AgentFailure failure = Malformed(target, 0, calls[0].replica, box.status());
    return {failure.ToStatus(), {failure}};
  }
  return {ActiveExtent{.active_block_count = calls[0].response.active_block_count(),
                       .cells = *std::move(box)},
          std::move(failures)};
}

QueryOutcome<std::vector<PointAnswer>> AskPoints(const QueryTarget& target,
                                                 const std::vector<ShownPoint>& points,
                                                 const base::TraceContext& identity,
                                                 const base::Cancellation& cancellation) {
  Calls<v1::GetGradientsRequest, v1::GetGradientsResponse> calls(target.parts.size());
  for (std::size_t i = 0; i < calls.size(); ++i) {
    v1::GetGradientsRequest& request = calls[i].request;
    request.set_dataset_id(target.dataset_id);
    for (const int shard : target.parts[i].shard_indices) {
      request.add_shard_indices(shard);
    }
    for (const ShownPoint& point : points) {
      *request.add_points() = rpc::ToProto(point.position);
      request.add_block_ids(point.block_id);
    }
  }
  std::vector<AgentFailure> failures = RunCalls(
      target, identity, cancellation,
      [](auto* call, auto on_done) {
        call->stub->async()->GetGradients(call->context.get(), &call->request, &call->response,
                                          std::move(on_done));
      },
      &calls);
  if (!AllAnswered(calls)) {
    absl::Status error = ErrorOf(failures, cancellation);
    return {std::move(error), std::move(failures)};
  }
  std::vector<std::optional<math::Vec3d>> gradients(points.size());
  std::vector<std::optional<int>> shards(points.size());
  for (std::size_t i = 0; i < calls.size(); ++i) {
    absl::Status status = rpc::AddGradients(calls[i].response, &gradients);
    status.Update(rpc::AddPointShards(calls[i].response, target.parts[i].shard_indices, &shards));
    if (!status.ok()) {
      AgentFailure failure = Malformed(target, i, calls[i].replica, status);
      return {failure.ToStatus(), {failure}};
    }
  }
  std::vector<PointAnswer> answers(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    answers[i] = {.gradient = gradients[i], .shard_index = shards[i]};
  }
  return {std::move(answers), std::move(failures)};
}

}  // namespace isoscope::server
