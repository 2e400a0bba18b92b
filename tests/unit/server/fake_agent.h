// Agents of a script: real gRPC servers on free ports of this machine whose answers a test decides.

#ifndef ISOSCOPE_TESTS_UNIT_SERVER_FAKE_AGENT_H_
#define ISOSCOPE_TESTS_UNIT_SERVER_FAKE_AGENT_H_

#include <atomic>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include "core/base/check.h"
#include "core/base/monotonic_time.h"
#include "isoscope/internal/v1/partition_agent_service.grpc.pb.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"
#include "rpc/unary_checksum.h"
#include "tests/support/held_port.h"
#include "tests/unit/server/make_shard.h"

namespace isoscope::testing {

// A blocking service: each call has a thread of its own, so scripts may block.
class FakeAgent final : public isoscope::internal::v1::PartitionAgentService::Service {
 public:
  // A frame's stream, from its first message.
  class FrameStream {
   public:
    using Stream = grpc::ServerReaderWriter<isoscope::internal::v1::RenderFrameResponse,
                                            isoscope::internal::v1::RenderFrameRequest>;

    // begin: the first message, which was read already
    FrameStream(Stream* stream, isoscope::internal::v1::RenderFrameRequest begin)
        : stream_(*stream), begin_(std::move(begin)) {}

    bool Read(isoscope::internal::v1::RenderFrameRequest* request) {
      if (!begin_) {
        return stream_.Read(request);
      }
      *request = *std::move(begin_);
      begin_.reset();
      return true;
    }
    bool Write(const isoscope::internal::v1::RenderFrameResponse& response) {
      return stream_.Write(response);
    }

   private:
    Stream& stream_;
    std::optional<isoscope::internal::v1::RenderFrameRequest> begin_;
  };
  using SurfaceWriter = grpc::ServerWriter<isoscope::internal::v1::ExtractSurfaceResponse>;

  explicit FakeAgent(std::vector<isoscope::internal::v1::ShardDescription> shards)
      : shards_(std::move(shards)) {}
  ~FakeAgent() override { Stop(); }

  // Before Start.
  void SetShards(std::vector<isoscope::internal::v1::ShardDescription> shards) {
    shards_ = std::move(shards);
  }

  // Whether it says that it is about to stop.
  std::atomic<bool> is_draining{false};

  // Set before Start.
  std::function<void()> on_describe = [] {};
  std::function<grpc::Status(grpc::ServerContext*, FrameStream*)> on_frame;
  // No other call of a frame follows. The coordinator does not wait for these.
  std::function<grpc::Status(grpc::ServerContext*, FrameStream*)> on_frame_end =
      [](grpc::ServerContext*, FrameStream*) { return grpc::Status::OK; };
  std::function<grpc::Status(grpc::ServerContext*, SurfaceWriter*)> on_surface;
  std::function<grpc::Status(grpc::ServerContext*,
                             const isoscope::internal::v1::GetShardHistogramRequest&,
                             isoscope::internal::v1::GetShardHistogramResponse*)>
      on_histogram;
  std::function<grpc::Status(const isoscope::internal::v1::GetActiveBoxRequest&,
                             isoscope::internal::v1::GetActiveBoxResponse*)>
      on_active_box;
  std::function<grpc::Status(const isoscope::internal::v1::GetCellBoxRequest&,
                             isoscope::internal::v1::GetCellBoxResponse*)>
      on_cell_box;
  std::function<grpc::Status(const isoscope::internal::v1::GetDepthBoundsRequest&,
                             isoscope::internal::v1::GetDepthBoundsResponse*)>
      on_depth_bounds;
  std::function<grpc::Status(const isoscope::internal::v1::GetResolvedBlocksRequest&,
                             isoscope::internal::v1::GetResolvedBlocksResponse*)>
      on_resolved_blocks;

  // On a port that nobody else has until the next start or its end.
  void Start() {
    port_ = HeldPort::Bind(0);
    StartAgain();
  }
  // On the port that it had.
  void StartAgain() {
    ISOSCOPE_CHECK(port_ != nullptr);
    grpc::ServerBuilder builder;
    rpc::ConfigureServer(&builder);
    builder.RegisterService(this);
    auto running = rpc::StartServer(&builder, port_->address());
    ISOSCOPE_CHECK(running.ok());
    server_ = std::move(running->server);
  }
  // As if the process were killed: connections are cut.
  void Stop() {
    if (server_ != nullptr) {
      server_->Shutdown(base::MonotonicNow());
      server_.reset();
    }
  }

  [[nodiscard]] std::string address() const { return port_->address(); }

  grpc::Status DescribeShards(grpc::ServerContext* context,
                              const isoscope::internal::v1::DescribeShardsRequest* request,
                              isoscope::internal::v1::DescribeShardsResponse* response) override {
    on_describe();
    response->set_version("1.2.3");
    response->set_renderer("fake");
    response->mutable_picture_revision()->set_number(1);
    response->mutable_picture_revision()->set_back_end(
        isoscope::internal::v1::PictureRevision::BACK_END_CPU);
    response->set_is_draining(is_draining.load());
    response->mutable_shards()->Assign(shards_.begin(), shards_.end());
    return Answer(*request, *response, grpc::Status::OK, context);
  }
  grpc::Status RenderFrame(grpc::ServerContext* context, FrameStream::Stream* stream) override {
    isoscope::internal::v1::RenderFrameRequest begin;
    if (!stream->Read(&begin)) {
      return grpc::Status::CANCELLED;
    }
    const bool is_end = begin.has_begin() && !begin.begin().has_frame();
    FrameStream rest(stream, std::move(begin));
    return is_end ? on_frame_end(context, &rest) : on_frame(context, &rest);
  }
  grpc::Status ExtractSurface(grpc::ServerContext* context,
                              const isoscope::internal::v1::ExtractSurfaceRequest* /*request*/,
                              SurfaceWriter* writer) override {
    return on_surface(context, writer);
  }
  grpc::Status GetShardHistogram(
      grpc::ServerContext* context, const isoscope::internal::v1::GetShardHistogramRequest* request,
      isoscope::internal::v1::GetShardHistogramResponse* response) override {
    return Answer(*request, *response, on_histogram(context, *request, response), context);
  }
  grpc::Status GetActiveBox(grpc::ServerContext* context,
                            const isoscope::internal::v1::GetActiveBoxRequest* request,
                            isoscope::internal::v1::GetActiveBoxResponse* response) override {
    return Answer(*request, *response, on_active_box(*request, response), context);
  }
  grpc::Status GetCellBox(grpc::ServerContext* context,
                          const isoscope::internal::v1::GetCellBoxRequest* request,
                          isoscope::internal::v1::GetCellBoxResponse* response) override {
    return Answer(*request, *response, on_cell_box(*request, response), context);
  }
  grpc::Status GetDepthBounds(grpc::ServerContext* context,
                              const isoscope::internal::v1::GetDepthBoundsRequest* request,
                              isoscope::internal::v1::GetDepthBoundsResponse* response) override {
    return Answer(*request, *response, on_depth_bounds(*request, response), context);
  }
  grpc::Status GetResolvedBlocks(
      grpc::ServerContext* context, const isoscope::internal::v1::GetResolvedBlocksRequest* request,
      isoscope::internal::v1::GetResolvedBlocksResponse* response) override {
    return Answer(*request, *response, on_resolved_blocks(*request, response), context);
  }

 private:
  static grpc::Status Answer(const google::protobuf::Message& request,
                             const google::protobuf::Message& response, const grpc::Status& status,
                             grpc::ServerContext* context) {
    rpc::AnswerChecksum(request, rpc::ToAbslStatus(status), response, context);
    return status;
  }

  std::vector<isoscope::internal::v1::ShardDescription> shards_;
  std::shared_ptr<const HeldPort> port_;
  std::unique_ptr<grpc::Server> server_;
};

// Plays an agent that has nothing to draw, to the end.
//
// trace: told with the end of the frame, if one is given
inline grpc::Status PlayEmptyFrame(FakeAgent::FrameStream* stream,
                                   const isoscope::internal::v1::AgentTrace* trace = nullptr) {
  namespace v1 = isoscope::internal::v1;
  v1::RenderFrameRequest request;
  v1::RenderFrameResponse response;
  if (!stream->Read(&request)) {
    return {grpc::StatusCode::INVALID_ARGUMENT, "no begin"};
  }
  if (request.begin().frame().culling() != isoscope::v1::CULLING_NONE) {
    response.mutable_ray_hits();
    stream->Write(response);
    stream->Read(&request);
    response.mutable_occluders_done();
    stream->Write(response);
    stream->Read(&request);
  }
  response.mutable_frame_done()->mutable_statistics()->set_triangle_count(7);
  response.mutable_frame_done()->mutable_statistics()->set_active_block_count(5);
  response.mutable_frame_done()->mutable_statistics()->set_visible_block_count(3);
  if (trace != nullptr) {
    *response.mutable_frame_done()->mutable_trace() = *trace;
  }
  stream->Write(response);
  return grpc::Status::OK;
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_UNIT_SERVER_FAKE_AGENT_H_
