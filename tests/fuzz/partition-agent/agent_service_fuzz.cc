// The agent's service over gRPC: the messages of a frame in any order, and its other calls.
//
// Input: a byte that chooses the call, a byte of ways, then a piece for each message. Ways:
//
//   1  the messages keep their dataset; else they get the right one (fuzzers do not guess ids)
//   2  all messages of a frame come at once; else each waits for the answer to the one before
//
// Every call ends, by a documented code. No frame stays in work. A good frame has the same bytes
// whatever came before.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include <grpcpp/client_context.h>

#include "core/base/monotonic_time.h"
#include "core/base/task_arena.h"
#include "core/render/renderer_factory.h"
#include "isoscope/internal/v1/partition_agent_service.grpc.pb.h"
#include "partition-agent/agent_server.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/unit/partition-agent/small_dataset.h"
#include "wire/frame_convert.h"
#include "wire/proto_convert.h"

namespace isoscope::fuzz {
namespace {

namespace v1 = isoscope::internal::v1;

// Far more than any call may take.
constexpr absl::Duration kPatience = absl::Seconds(60);
constexpr int kMaxSidePx = 64;
// Sanitizers take a part of it.
constexpr std::size_t kAgentBytes = std::size_t{1} << 30;
constexpr int kInputsBetweenGoodFrames = 64;

class Agent {
 public:
  Agent() {
    auto renderer = render::MakeRenderer({.kind = render::RendererKind::kCpu});
    Require(renderer.ok() && memory_->Settle().ok(), "an agent can be made");
    agent::AgentServerOptions options;
    options.directories = {dataset_.directory()};
    // A port: within a process gRPC blocks writers whose reader has left.
    options.listen_address = "127.0.0.1:0";
    options.renderer = *std::move(renderer);
    options.arena = std::make_shared<base::TaskArena>(1);
    options.memory = memory_;
    auto server = agent::AgentServer::Start(options);
    Require(server.ok(), "an agent can be started");
    server_ = *std::move(server);
    stub_ = v1::PartitionAgentService::NewStub(
        rpc::MakeChannel(absl::StrCat("127.0.0.1:", server_->port())));
  }

  [[nodiscard]] v1::RenderFrameRequest Begin(isoscope::v1::Culling culling) const {
    const agent::FrameTask task = dataset_.Request();
    v1::RenderFrameRequest message;
    v1::BeginFrame* const begin = message.mutable_begin();
    begin->set_frame_number(1);
    begin->set_dataset_id(id());
    begin->add_shard_indices(0);
    begin->add_shard_indices(1);
    begin->set_agent_count(1);
    begin->set_report_active_blocks(true);
    frame::FrameSpec spec = task.spec;
    spec.viewport = {.width_px = 40, .height_px = 30};
    *begin->mutable_frame() = wire::ToProto(spec);
    begin->mutable_frame()->set_culling(culling);
    return message;
  }
  [[nodiscard]] const std::string& id() const { return dataset_.manifest().dataset_id; }
  v1::PartitionAgentService::Stub* stub() { return stub_.get(); }

  // The bands of a frame of these messages, and how it ended.
  absl::Status Render(const std::vector<v1::RenderFrameRequest>& messages, bool waits,
                      std::string* bands) {
    grpc::ClientContext context;
    context.set_deadline(base::MonotonicNow() + kPatience);
    const auto stream = stub_->RenderFrame(&context);
    const auto read = [&] {
      v1::RenderFrameResponse response;
      const bool is_there = stream->Read(&response);
      for (const std::string& band : response.bands()) {
        *bands += band;
      }
      return is_there;
    };
    for (const v1::RenderFrameRequest& message : messages) {
      if (!stream->Write(message) || (waits && !read())) {
        break;
      }
    }
    stream->WritesDone();
    while (read()) {
    }
    return rpc::ToAbslStatus(stream->Finish());
  }

  void RequireIdle() const {
    const base::MonotonicTime limit = base::MonotonicNow() + kPatience;
    while (server_->frames_in_work() > 0) {
      Require(base::MonotonicNow() < limit, "no frame stays in work");
      absl::SleepFor(absl::Microseconds(200));
    }
  }

  void RequireGoodFrame() {
    std::string bands;
    const absl::Status status = Render({Begin(isoscope::v1::CULLING_NONE)}, true, &bands);
    Require(status.ok(), absl::StrCat("a good frame is drawn, not ", status.ToString()));
    if (good_bands_.empty()) {
      good_bands_ = bands;
    }
    Require(bands == good_bands_, "a good frame has the same bytes whatever came before");
  }

 private:
  const testing::SmallDataset dataset_{2, {21, 19, 17}};
  const std::shared_ptr<agent::AgentMemory> memory_ =
      std::make_shared<agent::AgentMemory>(kAgentBytes);
  std::unique_ptr<agent::AgentServer> server_;
  std::unique_ptr<v1::PartitionAgentService::Stub> stub_;
  std::string good_bands_;
};

Agent& TheAgent() {
  static Agent agent;
  return agent;
}

void RequireEnd(const absl::Status& status) {
  if (!status.ok()) {
    using absl::StatusCode;
    RequireError(status, {StatusCode::kInvalidArgument, StatusCode::kFailedPrecondition,
                          StatusCode::kResourceExhausted, StatusCode::kCancelled});
  }
}

// Small pictures, so that inputs are many.
void Bound(v1::FrameSpec* frame) {
  if (frame->has_viewport()) {
    isoscope::v1::Viewport* const viewport = frame->mutable_viewport();
    viewport->set_width_px(std::min(viewport->width_px(), kMaxSidePx));
    viewport->set_height_px(std::min(viewport->height_px(), kMaxSidePx));
  }
}

template <typename Message>
bool Parse(absl::string_view bytes, bool has_right_dataset, Message* message) {
  if (!message->ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) {
    return false;
  }
  if (has_right_dataset) {
    message->set_dataset_id(TheAgent().id());
  }
  return true;
}

void RenderFrame(Input input, bool has_right_dataset, bool waits) {
  std::vector<v1::RenderFrameRequest> messages;
  while (!input.empty() && messages.size() < 8) {
    const absl::string_view bytes = input.Piece();
    v1::RenderFrameRequest message;
    if (!message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) {
      continue;
    }
    if (message.has_begin()) {
      Bound(message.mutable_begin()->mutable_frame());
      if (has_right_dataset) {
        message.mutable_begin()->set_dataset_id(TheAgent().id());
      }
    }
    messages.push_back(message);
  }
  std::string bands;
  RequireEnd(TheAgent().Render(messages, waits, &bands));
}

void ExtractSurface(absl::string_view bytes, bool has_right_dataset) {
  v1::ExtractSurfaceRequest request;
  if (!Parse(bytes, has_right_dataset, &request)) {
    return;
  }
  grpc::ClientContext context;
  context.set_deadline(base::MonotonicNow() + kPatience);
  const auto reader = TheAgent().stub()->ExtractSurface(&context, request);
  v1::ExtractSurfaceResponse response;
  while (reader->Read(&response)) {
    for (const v1::BlockSurface& block : response.blocks()) {
      Require(block.triangles().size() % 12 == 0 && block.positions().size() % 12 == 0,
              "a surface has whole triangles and whole points");
    }
  }
  RequireEnd(rpc::ToAbslStatus(reader->Finish()));
}

template <typename Request, typename Response, typename Method>
void Ask(Method method, absl::string_view bytes, bool has_right_dataset) {
  Request request;
  if (!Parse(bytes, has_right_dataset, &request)) {
    return;
  }
  grpc::ClientContext context;
  context.set_deadline(base::MonotonicNow() + kPatience);
  Response response;
  RequireEnd(rpc::ToAbslStatus((TheAgent().stub()->*method)(&context, request, &response)));
}

void Run(Input input) {
  using Stub = v1::PartitionAgentService::Stub;
  const std::uint8_t call = input.Byte();
  const std::uint8_t ways = input.Byte();
  const bool has_right_dataset = (ways & 1) == 0;
  switch (call % 8) {
    case 0:
      return ExtractSurface(input.Piece(), has_right_dataset);
    case 1:
      return Ask<v1::GetShardHistogramRequest, v1::GetShardHistogramResponse>(
          &Stub::GetShardHistogram, input.Piece(), has_right_dataset);
    case 2:
      if ((ways & 4) != 0) {
        return Ask<v1::GetCellBoxRequest, v1::GetCellBoxResponse>(&Stub::GetCellBox, input.Piece(),
                                                                  has_right_dataset);
      }
      if ((ways & 8) != 0) {
        return Ask<v1::GetDepthBoundsRequest, v1::GetDepthBoundsResponse>(
            &Stub::GetDepthBounds, input.Piece(), has_right_dataset);
      }
      return Ask<v1::GetActiveBoxRequest, v1::GetActiveBoxResponse>(
          &Stub::GetActiveBox, input.Piece(), has_right_dataset);
    case 3:
      return Ask<v1::GetGradientsRequest, v1::GetGradientsResponse>(
          &Stub::GetGradients, input.Piece(), has_right_dataset);
    default:
      return RenderFrame(input, has_right_dataset, (ways & 2) == 0);
  }
}

}  // namespace

std::vector<std::string> Seeds() {
  const auto head = [](int call) { return std::string{static_cast<char>(call), '\0'}; };
  const std::string begin = TheAgent().Begin(isoscope::v1::CULLING_DEPTH).SerializeAsString();
  v1::RenderFrameRequest occluders;
  *occluders.mutable_occluders()->mutable_blocks() =
      wire::ToProto(std::vector<volume::BlockId>{0, 3});
  v1::RenderFrameRequest visible;
  *visible.mutable_visible_blocks()->mutable_blocks() =
      wire::ToProto(std::vector<volume::BlockId>{1, 2, 4});
  v1::ExtractSurfaceRequest surface;
  surface.set_isovalue(testing::SmallDataset::kIsovalue);
  surface.add_shard_indices(0);
  surface.add_shard_indices(1);
  v1::GetShardHistogramRequest histogram;
  histogram.add_shard_indices(1);
  histogram.set_max_bin_count(16);
  v1::GetActiveBoxRequest box;
  box.add_isovalues(128);
  v1::GetCellBoxRequest cell_box;
  cell_box.add_shard_indices(0);
  cell_box.add_shard_indices(1);
  cell_box.add_isovalues(128);
  v1::GetDepthBoundsRequest bounds;
  *bounds.mutable_frame() = TheAgent().Begin(isoscope::v1::CULLING_DEPTH).begin().frame();
  bounds.set_part_count(2);
  v1::GetGradientsRequest gradients;
  gradients.add_shard_indices(0);
  gradients.add_points()->set_x(3);
  v1::GetGradientsRequest values = gradients;
  values.add_block_ids(0);
  values.mutable_values()->add_dataset_ids("other");
  values.mutable_values()->add_isovalues(testing::SmallDataset::kIsovalue);
  values.add_on_caps(false);
  v1::GetGradientsRequest labels = gradients;
  labels.add_block_ids(0);
  labels.add_on_caps(false);
  labels.add_label_sets()->add_labels(testing::SmallDataset::kIsovalue);
  labels.add_label_set_indices(0);
  const std::string first = MakePiece(occluders.SerializeAsString());
  const std::string second = MakePiece(visible.SerializeAsString());
  return {head(4) + MakePiece(begin) + first + second,
          head(4) + MakePiece(TheAgent().Begin(isoscope::v1::CULLING_NONE).SerializeAsString()),
          head(5) + first + MakePiece(begin) + second,
          head(6) + MakePiece(begin) + MakePiece(begin),
          head(7) + MakePiece(begin) + second + first,
          head(0) + MakePiece(surface.SerializeAsString()),
          head(1) + MakePiece(histogram.SerializeAsString()),
          head(2) + MakePiece(box.SerializeAsString()),
          std::string{2, 4} + MakePiece(cell_box.SerializeAsString()),
          std::string{2, 8} + MakePiece(bounds.SerializeAsString()),
          head(3) + MakePiece(gradients.SerializeAsString()),
          head(3) + MakePiece(values.SerializeAsString()),
          head(3) + MakePiece(labels.SerializeAsString())};
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static int count = 0;
  isoscope::fuzz::Run(isoscope::fuzz::Input(data, size));
  isoscope::fuzz::TheAgent().RequireIdle();
  if (count++ % isoscope::fuzz::kInputsBetweenGoodFrames == 0) {
    isoscope::fuzz::TheAgent().RequireGoodFrame();
  }
  return 0;
}
