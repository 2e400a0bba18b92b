// PartitionAgentService over gRPC's callback API. It counts and answers calls; agent_queries,
// frame_answerer and surface_extraction compute the answers, agent_streams sends them.

#ifndef ISOSCOPE_PARTITION_AGENT_PARTITION_AGENT_SERVICE_IMPL_H_
#define ISOSCOPE_PARTITION_AGENT_PARTITION_AGENT_SERVICE_IMPL_H_

#include <atomic>
#include <vector>

#include "core/base/metrics.h"
#include "core/base/monotonic_time.h"
#include "isoscope/internal/v1/partition_agent_service.grpc.pb.h"
#include "partition-agent/agent_context.h"
#include "partition-agent/agent_streams.h"
#include "rpc/certificate_watch.h"
#include "rpc/unary_call.h"

namespace isoscope::agent {

// Thread-safe. Destroy it only after its server has shut down.
class PartitionAgentServiceImpl final
    : public isoscope::internal::v1::PartitionAgentService::CallbackService {
 public:
  // The shards are being opened.
  explicit PartitionAgentServiceImpl(const AgentServerOptions& options);
  // Serves them from now on; at least one. Call it once.
  void Serve(Shards plain, SeriesShards series);

  [[nodiscard]] bool is_open() const { return agent_.shards.is_filled(); }
  [[nodiscard]] Opening* opening() { return &agent_.opening; }
  [[nodiscard]] const Opening* opening() const { return &agent_.opening; }

  // Frames whose call has not ended yet.
  [[nodiscard]] int frames_in_work() const { return agent_.frame_count.load(); }
  // Reports to coordinators from now on that this agent stops soon. It continues to serve.
  void AnnounceDrain() { is_draining_.store(true); }
  // Refuses new frames and questions from now on. Waits until frames that have begun have ended, with
  // all their calls, at most until `deadline`.
  void FinishFrames(base::MonotonicTime deadline);
  // Returns the metrics for monitoring.
  [[nodiscard]] std::vector<base::MetricFamily> CollectMetrics(
      rpc::CertificateWatch* certificate) const;

  grpc::ServerUnaryReactor* DescribeShards(
      grpc::CallbackServerContext* context,
      const isoscope::internal::v1::DescribeShardsRequest* request,
      isoscope::internal::v1::DescribeShardsResponse* response) override;
  FrameReactor* RenderFrame(grpc::CallbackServerContext* context) override {
    return StartRenderFrame(&agent_, context);
  }
  SurfaceReactor* ExtractSurface(
      grpc::CallbackServerContext* context,
      const isoscope::internal::v1::ExtractSurfaceRequest* request) override {
    return StartExtractSurface(&agent_, context, *request);
  }
  grpc::ServerUnaryReactor* GetShardHistogram(
      grpc::CallbackServerContext* context,
      const isoscope::internal::v1::GetShardHistogramRequest* request,
      isoscope::internal::v1::GetShardHistogramResponse* response) override {
    return StartQuery(AgentMethod::kGetShardHistogram, context, request, response);
  }
  grpc::ServerUnaryReactor* GetActiveBox(
      grpc::CallbackServerContext* context,
      const isoscope::internal::v1::GetActiveBoxRequest* request,
      isoscope::internal::v1::GetActiveBoxResponse* response) override {
    return StartQuery(AgentMethod::kGetActiveBox, context, request, response);
  }
  grpc::ServerUnaryReactor* GetCellBox(
      grpc::CallbackServerContext* context,
      const isoscope::internal::v1::GetCellBoxRequest* request,
      isoscope::internal::v1::GetCellBoxResponse* response) override {
    return StartQuery(AgentMethod::kGetCellBox, context, request, response);
  }
  grpc::ServerUnaryReactor* GetGradients(
      grpc::CallbackServerContext* context,
      const isoscope::internal::v1::GetGradientsRequest* request,
      isoscope::internal::v1::GetGradientsResponse* response) override {
    return StartQuery(AgentMethod::kGetGradients, context, request, response);
  }
  grpc::ServerUnaryReactor* GetDepthBounds(
      grpc::CallbackServerContext* context,
      const isoscope::internal::v1::GetDepthBoundsRequest* request,
      isoscope::internal::v1::GetDepthBoundsResponse* response) override {
    return StartQuery(AgentMethod::kGetDepthBounds, context, request, response);
  }
  grpc::ServerUnaryReactor* GetResolvedBlocks(
      grpc::CallbackServerContext* context,
      const isoscope::internal::v1::GetResolvedBlocksRequest* request,
      isoscope::internal::v1::GetResolvedBlocksResponse* response) override {
    return StartQuery(AgentMethod::kGetResolvedBlocks, context, request, response);
  }

 private:
  // Answers on a thread of the query executor (AnswerQuery).
  template <typename Request, typename Response>
  grpc::ServerUnaryReactor* StartQuery(AgentMethod method, grpc::CallbackServerContext* context,
                                       const Request* request, Response* response);
  // Fills the answer of DescribeShards.
  void Describe(isoscope::internal::v1::DescribeShardsResponse* response);
  [[nodiscard]] isoscope::v1::AgentLoad Load() const;
  // Counts a call, and gives its answer the checksum. The messages live as long as the call.
  [[nodiscard]] rpc::OnCallEnd UnaryEnd(AgentMethod method,
                                        const google::protobuf::Message* request,
                                        const google::protobuf::Message* response,
                                        grpc::CallbackServerContext* context);

  const base::MonotonicTime start_ = base::MonotonicNow();
  std::atomic<bool> is_draining_{false};
  AgentContext agent_;
  // Without shards until agent_.shards.is_filled(), and set before.
  isoscope::internal::v1::DescribeShardsResponse plain_description_;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_PARTITION_AGENT_SERVICE_IMPL_H_
