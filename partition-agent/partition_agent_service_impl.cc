#include "partition-agent/partition_agent_service_impl.h"

#include <cstddef>
#include <memory>
#include <utility>

#include "absl/status/statusor.h"

#include "core/base/log.h"
#include "core/base/memory_info.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "partition-agent/agent_queries.h"
#include "partition-agent/begun_frames.h"
#include "rpc/request_context.h"
#include "rpc/unary_checksum.h"
#include "wire/known_fields.h"
#include "wire/proto_convert.h"

namespace isoscope::agent {

namespace v1 = isoscope::internal::v1;

PartitionAgentServiceImpl::PartitionAgentServiceImpl(const AgentServerOptions& options)
    : agent_(options) {
  wire::PrepareKnownFields(v1::RenderFrameRequest());
}

void PartitionAgentServiceImpl::Serve(Shards plain, SeriesShards series) {
  plain_description_ = DescribePlain(plain, *agent_.options.renderer);
  agent_.Serve(std::move(plain), std::move(series));
}

void PartitionAgentServiceImpl::FinishFrames(base::MonotonicTime deadline) {
  const std::size_t count = agent_.begun.Stop();
  AnnounceDrain();
  if (count > 0 && base::MonotonicNow() < deadline) {
    base::LogInfo("agent_finishes_frames", {{"frames", count}});
  }
  agent_.begun.AwaitEnd(deadline);
}

std::vector<base::MetricFamily> PartitionAgentServiceImpl::CollectMetrics(
    rpc::CertificateWatch* certificate) const {
  AgentGauges gauges = agent_.Gauges();
  gauges.certificate_days_left = certificate->DaysLeft();
  gauges.certificate_failures = certificate->failures();
  return agent_.metrics.Collect(gauges);
}

isoscope::v1::AgentLoad PartitionAgentServiceImpl::Load() const {
  const AgentMetrics& metrics = agent_.metrics;
  isoscope::v1::AgentLoad load;
  *load.mutable_up_duration() = wire::ToProto(base::MonotonicNow() - start_);
  load.set_working_frame_count(frames_in_work());
  load.set_done_frame_count(metrics.done_frames.value());
  load.set_failed_frame_count(metrics.failed_frames.value() + metrics.cancelled_frames.value());
  load.set_read_bytes(metrics.read_bytes.value());
  load.set_triangle_count(metrics.triangles.value());
  *load.mutable_busy_duration() = wire::ToProto(absl::Nanoseconds(metrics.busy.value()));
  load.set_resident_bytes(static_cast<std::int64_t>(base::ResidentBytes()));
  load.set_memory_limit_bytes(static_cast<std::int64_t>(agent_.options.memory->limit_bytes()));
  return load;
}

void PartitionAgentServiceImpl::Describe(v1::DescribeShardsResponse* response) {
  if (is_open()) {
    *response = plain_description_;
    AddSeries(agent_.shards, response);
    AddDamages(agent_.damages.damages(), response);
  } else {
    *response = DescribePlain({}, *agent_.options.renderer);
    AddOpening(agent_.opening.progress(), response);
  }
  *response->mutable_load() = Load();
  response->set_is_draining(is_draining_.load());
}

rpc::OnCallEnd PartitionAgentServiceImpl::UnaryEnd(AgentMethod method,
                                                   const google::protobuf::Message* request,
                                                   const google::protobuf::Message* response,
                                                   grpc::CallbackServerContext* context) {
  return [=, this](const absl::Status& status, absl::Duration duration,
                   const base::TraceContext& /*identity*/) {
    agent_.metrics.CountRequest(method, status, duration);
    rpc::AnswerChecksum(*request, status, *response, context);
  };
}

grpc::ServerUnaryReactor* PartitionAgentServiceImpl::DescribeShards(
    grpc::CallbackServerContext* context, const v1::DescribeShardsRequest* request,
    v1::DescribeShardsResponse* response) {
  const auto describe = [this, response] {
    Describe(response);
    return absl::OkStatus();
  };
  rpc::OnCallEnd end = UnaryEnd(AgentMethod::kDescribeShards, request, response, context);
  if (agent_.shards.series().empty()) {
    return rpc::AnswerUnary(context, *request, describe, end);
  }
  // Reads the disk, which a thread of gRPC must not wait for.
  constexpr absl::Duration kMaxDuration = absl::Minutes(1);
  return rpc::UnaryTask::Start(
      context, *request, agent_.series_executor.get(), kMaxDuration,
      [describe](const base::Cancellation& /*cancellation*/,
                 const base::TraceContext& /*identity*/) { return describe(); },
      std::move(end));
}

// Questions that read blocks, on the threads of frames.
template <typename Request>
constexpr bool kReadsBlocks = std::is_same_v<Request, v1::GetCellBoxRequest> ||
                              std::is_same_v<Request, v1::GetResolvedBlocksRequest>;

template <typename Request, typename Response>
grpc::ServerUnaryReactor* PartitionAgentServiceImpl::StartQuery(
    AgentMethod method, grpc::CallbackServerContext* context, const Request* request,
    Response* response) {
  absl::Duration max_duration = absl::Minutes(1);
  base::Executor* executor = &agent_.query_executor;
  if constexpr (std::is_same_v<Request, v1::GetShardHistogramRequest>) {
    if (request->max_label_value_count() > 0) {
      max_duration = absl::Hours(1);  // it reads all samples, as the coordinator knows
      executor = &agent_.label_executor;
    }
  }
  if constexpr (kReadsBlocks<Request>) {
    max_duration = absl::Hours(1);  // the frame that waits for it has a deadline of its own
  }
  // One that has arrived before the agent stops is answered.
  auto begun = std::make_shared<absl::StatusOr<BegunFrames::Call>>(
      agent_.begun.BeginQuestion(rpc::TraceContextOf(*context).request_id()));
  return rpc::UnaryTask::Start(
      context, *request, executor, max_duration,
      [this, request, response, begun = std::move(begun)](const base::Cancellation& cancellation,
                                                          const base::TraceContext& /*identity*/) {
        ISOSCOPE_RETURN_IF_ERROR(begun->status());
        if constexpr (kReadsBlocks<Request> || std::is_same_v<Request, v1::GetDepthBoundsRequest>) {
          return agent_.damages.ForCaller(AnswerQuery(agent_.shards, agent_.Resources(nullptr),
                                                      *request, cancellation, response));
        } else {
          return agent_.damages.ForCaller(
              AnswerQuery(agent_.shards, *request, cancellation, response));
        }
      },
      UnaryEnd(method, request, response, context));
}

}  // namespace isoscope::agent
