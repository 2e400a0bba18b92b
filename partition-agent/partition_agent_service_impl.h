// PartitionAgentService over gRPC's callback API. Reactions hand over to executors; frame_pipeline
// and surface_extraction do the work.

#ifndef ISOSCOPE_PARTITION_AGENT_PARTITION_AGENT_SERVICE_IMPL_H_
#define ISOSCOPE_PARTITION_AGENT_PARTITION_AGENT_SERVICE_IMPL_H_

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include <oneapi/tbb/task_arena.h>

#include "core/base/executor.h"
#include "core/base/metrics.h"
#include "core/base/trace_recorder.h"
#include "core/image/pixel_mailboxes.h"
#include "core/render/renderer.h"
#include "core/rpc/certificate_watch.h"
#include "core/rpc/unary_call.h"
#include "isoscope/internal/v1/partition_agent_service.grpc.pb.h"
#include "partition-agent/agent_memory.h"
#include "partition-agent/agent_metrics.h"
#include "partition-agent/agent_resources.h"
#include "partition-agent/shard.h"

namespace isoscope::agent {

struct PartitionAgentServiceOptions {
  std::vector<std::shared_ptr<const Shard>> shards;  // at least one
  std::shared_ptr<render::Renderer> renderer;
  std::shared_ptr<tbb::task_arena> arena;
  std::shared_ptr<AgentMemory> memory;
  std::shared_ptr<image::PixelMailboxes> mailboxes = nullptr;  // null: pixels leave as bands
  int max_concurrent_frames = 4;                               // >= 1
  int max_queued_frames = 64;                                  // >= 0
  // As AgentServerOptions has them.
  std::shared_ptr<base::Executor> frame_executor = nullptr;
  bool one_thread_a_step = false;
};

// Thread-safe. Destroy it only after its server has shut down.
//
// A frame holds a thread only while a step runs, not while it waits for the coordinator. At most
// max_concurrent_frames + max_queued_frames frames are in work at a time. Extractions have threads
// of their own, kMaxConcurrentExtractions at a time, because a slow reader holds one for as long as
// it reads. So have questions about histograms and active blocks, which go through all blocks.
class PartitionAgentServiceImpl final
    : public isoscope::internal::v1::PartitionAgentService::CallbackService {
 public:
  static constexpr int kMaxConcurrentExtractions = 4;
  static constexpr int kMaxQueuedExtractions = 16;
  static constexpr int kMaxConcurrentQueries = 2;
  static constexpr int kMaxQueuedQueries = 64;

  explicit PartitionAgentServiceImpl(const PartitionAgentServiceOptions& options);
  ~PartitionAgentServiceImpl() override;

  // Frames whose call has not ended yet.
  [[nodiscard]] int frames_in_work() const { return frame_count_.load(); }
  // Tells coordinators from now on that this agent is about to stop. It serves on.
  void AnnounceDrain() { is_draining_.store(true); }
  // Returns the numbers for monitoring.
  [[nodiscard]] std::vector<base::MetricFamily> CollectMetrics(
      rpc::CertificateWatch* certificate) const {
    AgentGauges now = gauges();
    now.certificate_days_left = certificate->DaysLeft();
    now.certificate_failures = certificate->failures();
    return metrics_.Collect(now);
  }

  grpc::ServerUnaryReactor* DescribeShards(
      grpc::CallbackServerContext* context,
      const isoscope::internal::v1::DescribeShardsRequest* request,
      isoscope::internal::v1::DescribeShardsResponse* response) override;
  grpc::ServerBidiReactor<isoscope::internal::v1::RenderFrameRequest,
                          isoscope::internal::v1::RenderFrameResponse>*
  RenderFrame(grpc::CallbackServerContext* context) override;
  grpc::ServerWriteReactor<isoscope::internal::v1::ExtractSurfaceResponse>* ExtractSurface(
      grpc::CallbackServerContext* context,
      const isoscope::internal::v1::ExtractSurfaceRequest* request) override;
  grpc::ServerUnaryReactor* GetShardHistogram(
      grpc::CallbackServerContext* context,
      const isoscope::internal::v1::GetShardHistogramRequest* request,
      isoscope::internal::v1::GetShardHistogramResponse* response) override;
  grpc::ServerUnaryReactor* GetActiveBox(
      grpc::CallbackServerContext* context,
      const isoscope::internal::v1::GetActiveBoxRequest* request,
      isoscope::internal::v1::GetActiveBoxResponse* response) override;
  grpc::ServerUnaryReactor* GetGradients(
      grpc::CallbackServerContext* context,
      const isoscope::internal::v1::GetGradientsRequest* request,
      isoscope::internal::v1::GetGradientsResponse* response) override;

 private:
  class RenderFrameCall;
  class ExtractSurfaceCall;

  // `trace`: of a frame that has one.
  [[nodiscard]] AgentResources Resources(base::TraceRecorder* trace);
  [[nodiscard]] AgentGauges gauges() const;
  [[nodiscard]] isoscope::v1::AgentLoad Load() const;
  // Counts a call, and gives its answer the checksum. The messages live as long as the call.
  [[nodiscard]] rpc::OnCallEnd UnaryEnd(AgentMethod method,
                                        const google::protobuf::Message* request,
                                        const google::protobuf::Message* response,
                                        grpc::CallbackServerContext* context);

  // Finds the shards of a dataset by index. FAILED_PRECONDITION names the dataset or shard that is
  // not served; INVALID_ARGUMENT if the indices are malformed.
  absl::StatusOr<std::vector<std::shared_ptr<const Shard>>> FindShards(
      const std::string& dataset_id,
      const google::protobuf::RepeatedField<std::int32_t>& shard_indices) const;
  // Finds any shard of a dataset. FAILED_PRECONDITION if none is served.
  absl::StatusOr<std::shared_ptr<const Shard>> FindAnyShard(const std::string& dataset_id) const;

  const std::vector<std::shared_ptr<const Shard>> shards_;
  const std::shared_ptr<render::Renderer> renderer_;
  const std::unique_ptr<render::Renderer> cpu_renderer_;  // null if renderer_ is one
  const std::shared_ptr<tbb::task_arena> arena_;
  const bool one_thread_a_step_;
  const std::shared_ptr<AgentMemory> memory_;
  const std::shared_ptr<image::PixelMailboxes> mailboxes_;  // may be null
  const int max_frames_;
  isoscope::internal::v1::DescribeShardsResponse description_;
  std::atomic<int> frame_count_{0};  // begun and not yet ended
  std::atomic<bool> is_draining_{false};
  AgentMetrics metrics_;
  const absl::Time start_ = absl::Now();
  // These come last, because their threads use the members above.
  base::ExecutorShare frame_executor_;
  base::Executor extraction_executor_;
  base::Executor query_executor_;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_PARTITION_AGENT_SERVICE_IMPL_H_
