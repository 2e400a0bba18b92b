// The public services over gRPC, with a coordinator and a real agent in this process.
//
// Input: a byte that chooses the call, then a piece for each message of it.
//
// Every call ends, by a code that says who is at fault: not INTERNAL, not UNKNOWN. A picture has
// its size. A good picture has the same bytes whatever came before.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include <grpcpp/client_context.h>

#include "core/base/monotonic_time.h"
#include "core/base/task_arena.h"
#include "core/image/png_codec.h"
#include "core/render/renderer_factory.h"
#include "isoscope/v1/cluster_service.grpc.pb.h"
#include "isoscope/v1/dataset_service.grpc.pb.h"
#include "isoscope/v1/interact_service.grpc.pb.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "partition-agent/agent_server.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"
#include "server/coordinator_server.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/unit/partition-agent/small_dataset.h"

namespace isoscope::fuzz {
namespace {

namespace v1 = isoscope::v1;

// Far more than any call may take.
constexpr absl::Duration kPatience = absl::Seconds(60);
constexpr int kMaxSidePx = 64;
constexpr int kInputsBetweenGoodFrames = 64;

v1::RenderIsosurfaceRequest GoodRequest() {
  v1::RenderIsosurfaceRequest request;
  request.set_isovalue(testing::SmallDataset::kIsovalue);
  request.mutable_viewport()->set_width_px(40);
  request.mutable_viewport()->set_height_px(30);
  return request;
}

// Sanitizers take a part of it.
constexpr std::size_t kAgentBytes = std::size_t{1} << 30;

class Cluster {
 public:
  Cluster() {
    auto renderer = render::MakeRenderer({.kind = render::RendererKind::kCpu});
    const auto memory = std::make_shared<agent::AgentMemory>(kAgentBytes);
    const auto arena = std::make_shared<base::TaskArena>(1);
    Require(renderer.ok() && memory->Settle().ok(), "an agent can be made");
    agent::AgentServerOptions options;
    options.directories = {dataset_.directory()};
    options.renderer = *std::move(renderer);
    options.arena = arena;
    options.memory = memory;
    auto agent = agent::AgentServer::Start(options);
    Require(agent.ok(), "an agent can be started");
    agent_ = *std::move(agent);
    server::CoordinatorServerOptions coordinator;
    coordinator.agents = {{.target = "in-process:0", .channel = agent_->InProcessChannel()}};
    coordinator.arena = arena;
    // A port: within a process gRPC blocks writers whose reader has left.
    coordinator.listen_address = "127.0.0.1:0";
    coordinator.poll_interval = absl::Hours(1);
    auto started = server::CoordinatorServer::Start(coordinator);
    Require(started.ok() && (*started)->WaitUntilReady(base::MonotonicNow() + kPatience).ok(),
            "a coordinator can be started");
    coordinator_ = *std::move(started);
    const auto channel = rpc::MakeChannel(absl::StrCat("127.0.0.1:", coordinator_->port()));
    isosurface = v1::IsosurfaceService::NewStub(channel);
    datasets = v1::DatasetService::NewStub(channel);
    cluster = v1::ClusterService::NewStub(channel);
    interact = v1::InteractService::NewStub(channel);
  }
  ~Cluster() { coordinator_.reset(); }  // it calls the agent: it goes first
  Cluster(const Cluster&) = delete;
  Cluster& operator=(const Cluster&) = delete;

  std::unique_ptr<v1::IsosurfaceService::Stub> isosurface;
  std::unique_ptr<v1::DatasetService::Stub> datasets;
  std::unique_ptr<v1::ClusterService::Stub> cluster;
  std::unique_ptr<v1::InteractService::Stub> interact;

 private:
  const testing::SmallDataset dataset_{2, {21, 19, 17}};
  std::unique_ptr<agent::AgentServer> agent_;
  std::unique_ptr<server::CoordinatorServer> coordinator_;
};

Cluster& TheCluster() {
  static Cluster cluster;
  return cluster;
}

struct Call {
  Call() { context.set_deadline(base::MonotonicNow() + kPatience); }
  grpc::ClientContext context;
};

void RequireEnd(const grpc::Status& grpc_status) {
  const absl::Status status = rpc::ToAbslStatus(grpc_status);
  if (!status.ok()) {
    using absl::StatusCode;
    RequireError(status, {StatusCode::kInvalidArgument, StatusCode::kNotFound,
                          StatusCode::kFailedPrecondition, StatusCode::kResourceExhausted});
  }
}

// Small pictures, so that inputs are many.
void Bound(v1::RenderIsosurfaceRequest* request) {
  if (request->has_viewport()) {
    v1::Viewport* const viewport = request->mutable_viewport();
    viewport->set_width_px(std::min(viewport->width_px(), kMaxSidePx));
    viewport->set_height_px(std::min(viewport->height_px(), kMaxSidePx));
  }
}

template <typename Message>
bool Parse(absl::string_view bytes, Message* message) {
  return message->ParseFromArray(bytes.data(), static_cast<int>(bytes.size()));
}

void Render(absl::string_view bytes) {
  v1::RenderIsosurfaceRequest request;
  if (!Parse(bytes, &request)) {
    return;
  }
  Bound(&request);
  Call call;
  v1::RenderIsosurfaceResponse response;
  const grpc::Status status =
      TheCluster().isosurface->RenderIsosurface(&call.context, request, &response);
  RequireEnd(status);
  if (!status.ok() || response.png().empty()) {
    return;
  }
  const auto picture = image::DecodePng(response.png());
  Require(picture.ok(), "a picture can be decoded");
  const bool is_region = request.has_region();
  Require(
      picture->width == (is_region ? request.region().width_px() : request.viewport().width_px()) &&
          picture->height ==
              (is_region ? request.region().height_px() : request.viewport().height_px()),
      "a picture has the size that was asked for");
}

void RenderStream(absl::string_view bytes) {
  v1::RenderIsosurfaceStreamRequest request;
  if (!Parse(bytes, request.mutable_request())) {
    return;
  }
  Bound(request.mutable_request());
  Call call;
  const auto reader = TheCluster().isosurface->RenderIsosurfaceStream(&call.context, request);
  v1::RenderIsosurfaceStreamResponse response;
  while (reader->Read(&response)) {
  }
  RequireEnd(reader->Finish());
}

void Pick(absl::string_view bytes) {
  v1::PickSurfaceRequest request;
  if (!Parse(bytes, &request)) {
    return;
  }
  if (request.has_frame()) {
    Bound(request.mutable_frame());
  }
  Call call;
  v1::PickSurfaceResponse response;
  const grpc::Status status =
      TheCluster().isosurface->PickSurface(&call.context, request, &response);
  RequireEnd(status);
  Require(!status.ok() || response.points_size() == request.pixels_size(),
          "a pick answers for each pixel");
}

void Export(absl::string_view bytes) {
  v1::ExportIsosurfaceRequest request;
  if (!Parse(bytes, &request)) {
    return;
  }
  Call call;
  const auto reader = TheCluster().isosurface->ExportIsosurface(&call.context, request);
  v1::ExportIsosurfaceResponse response;
  while (reader->Read(&response)) {
  }
  RequireEnd(reader->Finish());
}

template <typename Request, typename Response, typename Stub, typename Method>
void Ask(Stub* stub, Method method, absl::string_view bytes) {
  Request request;
  if (!Parse(bytes, &request)) {
    return;
  }
  Call call;
  Response response;
  RequireEnd((stub->*method)(&call.context, request, &response));
}

// Sends states and reports, and reads until each state has its exact frame or the stream ends.
void Interact(Input input) {
  Call call;
  const auto stream = TheCluster().interact->Interact(&call.context);
  bool is_open = true;
  while (is_open && !input.empty()) {
    v1::InteractRequest request;
    if (!Parse(input.Piece(), &request)) {
      continue;
    }
    if (request.has_view_state()) {
      Bound(request.mutable_view_state()->mutable_frame());
    }
    is_open = stream->Write(request);
  }
  stream->WritesDone();
  v1::InteractResponse response;
  while (stream->Read(&response)) {
    Require(response.has_frame() || response.has_error() || response.frame_number() >= 0,
            "an answer says something");
  }
  RequireEnd(stream->Finish());
}

void Run(Input input) {
  Cluster& cluster = TheCluster();
  switch (input.Byte() % 9) {
    case 0:
    case 1:
      return Render(input.Piece());
    case 2:
      return RenderStream(input.Piece());
    case 3:
      return Pick(input.Piece());
    case 4:
      return Export(input.Piece());
    case 5:
      return Ask<v1::GetHistogramRequest, v1::GetHistogramResponse>(
          cluster.datasets.get(), &v1::DatasetService::Stub::GetHistogram, input.Piece());
    case 6:
      return Ask<v1::GetDatasetRequest, v1::GetDatasetResponse>(
          cluster.datasets.get(), &v1::DatasetService::Stub::GetDataset, input.Piece());
    case 7:
      return Ask<v1::GetClusterStatusRequest, v1::GetClusterStatusResponse>(
          cluster.cluster.get(), &v1::ClusterService::Stub::GetClusterStatus, input.Piece());
    default:
      return Interact(input);
  }
}

void RequireGoodFrame() {
  static std::string good_png;
  Call call;
  v1::RenderIsosurfaceResponse response;
  Require(TheCluster().isosurface->RenderIsosurface(&call.context, GoodRequest(), &response).ok(),
          "a good picture is made");
  if (good_png.empty()) {
    good_png = response.png();
  }
  Require(response.png() == good_png, "a good picture has the same bytes whatever came before");
}

}  // namespace

std::vector<std::string> Seeds() {
  std::vector<std::string> seeds;
  const auto add = [&](char call, const google::protobuf::Message& message) {
    seeds.push_back(std::string(1, call) + MakePiece(message.SerializeAsString()));
  };
  const v1::RenderIsosurfaceRequest plain = GoodRequest();
  add('\0', plain);
  v1::RenderIsosurfaceRequest rich = plain;
  rich.set_dataset("gyroid");
  rich.clear_isovalue();
  v1::Surface* const surface = rich.add_surfaces();
  surface->set_isovalue(128);
  surface->mutable_color()->set_green(1);
  surface->mutable_color()->set_alpha(0.5F);
  v1::ColorBy* const color_by = rich.add_surfaces()->mutable_color_by();
  rich.mutable_surfaces(1)->set_isovalue(100);
  color_by->set_quantity(v1::ColorBy::QUANTITY_GRADIENT_MAGNITUDE);
  color_by->set_color_map(v1::COLOR_MAP_TURBO);
  rich.mutable_clip()->add_half_spaces()->mutable_normal()->set_x(1);
  rich.mutable_ambient_occlusion()->set_radius_px(4);
  rich.mutable_silhouette()->set_width_px(1);
  rich.set_samples(4);
  rich.mutable_caps()->set_color_map(v1::COLOR_MAP_GREY);
  add('\0', rich);
  add('\2', rich);
  v1::RenderIsosurfaceRequest planes = plain;
  planes.mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_NONE);
  planes.mutable_output()->set_depth(true);
  planes.mutable_output()->set_position(true);
  planes.mutable_output()->set_normal(true);
  planes.set_camera_fit(v1::CAMERA_FIT_SURFACE);
  planes.set_with_trace(true);
  add('\1', planes);
  v1::RenderIsosurfaceRequest region = plain;
  region.mutable_region()->set_x(5);
  region.mutable_region()->set_width_px(9);
  region.mutable_region()->set_height_px(11);
  add('\1', region);
  v1::PickSurfaceRequest pick;
  *pick.mutable_frame() = plain;
  pick.add_pixels()->set_x(20);
  pick.mutable_pixels(0)->set_y(15);
  add('\3', pick);
  v1::ExportIsosurfaceRequest mesh;
  mesh.set_isovalue(128);
  add('\4', mesh);
  v1::GetHistogramRequest histogram;
  histogram.set_max_bin_count(16);
  add('\5', histogram);
  v1::GetDatasetRequest dataset;
  add('\6', dataset);
  v1::InteractRequest state;
  state.mutable_view_state()->set_sequence_number(1);
  *state.mutable_view_state()->mutable_frame() = plain;
  state.mutable_view_state()->set_target_frames_per_second(30);
  state.mutable_view_state()->set_is_at_rest(true);
  v1::InteractRequest shown;
  shown.mutable_frame_shown()->set_frame_number(1);
  add('\x8', state);
  seeds.push_back("\x8" + MakePiece(state.SerializeAsString()) +
                  MakePiece(shown.SerializeAsString()));
  return seeds;
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static int count = 0;
  isoscope::fuzz::Run(isoscope::fuzz::Input(data, size));
  if (count++ % isoscope::fuzz::kInputsBetweenGoodFrames == 0) {
    isoscope::fuzz::RequireGoodFrame();
  }
  return 0;
}
