// The agent's service as a coordinator meets it: raw protocol messages over an in-process channel.

#include <atomic>
#include <limits>
#include <map>
#include <span>
#include <thread>

#include "absl/strings/str_cat.h"
#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "gtest/gtest.h"
#include <grpcpp/client_context.h>

#include "core/base/error_reason.h"
#include "core/base/retry_delay.h"
#include "core/base/task_arena.h"
#include "core/composite/pixel_codec.h"
#include "core/render/renderer_factory.h"
#include "core/solid/block_surface.h"
#include "core/volume/label_values.h"
#include "isoscope/internal/v1/partition_agent_service.grpc.pb.h"
#include "partition-agent/agent_context.h"
#include "partition-agent/agent_server.h"
#include "partition-agent/frame/frame_pipeline.h"
#include "proto/message_checksum.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/signs_of_life.h"
#include "tests/support/block_cutter.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/partition-agent/small_dataset.h"
#include "wire/frame_convert.h"
#include "wire/proto_convert.h"

namespace isoscope::agent {
namespace {

namespace v1 = isoscope::internal::v1;

using isoscope::testing::SmallDataset;
using ::testing::AnyOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
// No two fragments of the scene have one depth.
constexpr image::FragmentOrder kOrder{.block_count = 1 << 20, .ties = image::TieRule::kColor};

// That of SmallDataset::Request.
constexpr view::Viewport kViewport{.width_px = 120, .height_px = 90};

using Stub = v1::PartitionAgentService::Stub;

std::string CodeOf(const grpc::Status& status) {
  return absl::StatusCodeToString(rpc::ToAbslStatus(status).code());
}

// The coordinator's side of one frame. Cancels it in the end, if it has not ended.
class FrameCall {
 public:
  explicit FrameCall(Stub* stub) : stream_(stub->RenderFrame(&context_)) {}
  // Of the request with this identity.
  FrameCall(Stub* stub, const std::string& traceparent) {
    context_.AddMetadata("traceparent", traceparent);
    stream_ = stub->RenderFrame(&context_);
  }
  ~FrameCall() {
    if (!is_finished_) {
      context_.TryCancel();
      Finish();
    }
  }

  bool Send(const v1::RenderFrameRequest& message) { return stream_->Write(message); }
  bool SendOccluders(const std::vector<volume::BlockId>& blocks) {
    v1::RenderFrameRequest message;
    *message.mutable_occluders()->mutable_blocks() = wire::ToProto(blocks);
    return Send(message);
  }
  bool SendVisible(const std::vector<volume::BlockId>& blocks, const std::string& open_pixels) {
    v1::RenderFrameRequest message;
    *message.mutable_visible_blocks()->mutable_blocks() = wire::ToProto(blocks);
    message.mutable_visible_blocks()->set_open_pixels(open_pixels);
    return Send(message);
  }
  bool Read(v1::RenderFrameResponse* message) { return stream_->Read(message); }
  // Composites the bands that come before or with another message, which is returned.
  v1::RenderFrameResponse ReadPixels(image::FrameImage* image) {
    v1::RenderFrameResponse message;
    while (stream_->Read(&message)) {
      for (const std::string& band : message.bands()) {
        EXPECT_THAT(composite::DecodePixelsInto(band, kOrder, {1, 1}, image),
                    isoscope::testing::IsOk());
      }
      if (message.message_case() != v1::RenderFrameResponse::MESSAGE_NOT_SET) {
        return message;
      }
    }
    return {};
  }
  // Step 2 without occluders, which shows nothing.
  void SkipOccluders() {
    image::FrameImage image(kViewport.width_px, kViewport.height_px);
    EXPECT_TRUE(SendOccluders({}));
    EXPECT_TRUE(ReadPixels(&image).has_occluders_done());
  }
  void EndWrites() { stream_->WritesDone(); }
  void Cancel() { context_.TryCancel(); }
  // Drops what was not read.
  grpc::Status Finish() {
    v1::RenderFrameResponse message;
    while (stream_->Read(&message)) {
    }
    is_finished_ = true;
    return stream_->Finish();
  }

 private:
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::RenderFrameRequest, v1::RenderFrameResponse>>
      stream_;
  bool is_finished_ = false;
};

// An agent answers before its shards are open.
class OpeningAgentTest : public ::testing::Test {
 protected:
  void SetUp() override {
    AgentServerOptions options;
    options.directories = {dataset_.directory()};
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(options.renderer,
                                  render::MakeRenderer({.kind = render::RendererKind::kCpu}));
    options.arena = std::make_shared<base::TaskArena>(1);
    options.memory = std::make_shared<AgentMemory>(std::size_t{1} << 30);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(server_, AgentServer::Listen(options));
    stub_ = v1::PartitionAgentService::NewStub(server_->InProcessChannel());
  }

  v1::DescribeShardsResponse Describe() {
    grpc::ClientContext context;
    v1::DescribeShardsResponse response;
    EXPECT_TRUE(stub_->DescribeShards(&context, {}, &response).ok());
    return response;
  }
  absl::Status AskForBox() {
    v1::GetActiveBoxRequest request;
    request.set_dataset_id(dataset_.manifest().dataset_id);
    request.add_isovalues(SmallDataset::kIsovalue);
    grpc::ClientContext context;
    v1::GetActiveBoxResponse response;
    return rpc::ToAbslStatus(stub_->GetActiveBox(&context, request, &response));
  }

  const SmallDataset dataset_{2};
  const base::Cancellation never_;
  std::unique_ptr<AgentServer> server_;
  std::unique_ptr<v1::PartitionAgentService::Stub> stub_;
};

TEST_F(OpeningAgentTest, ItSaysThatItOpensItsShardsUntilItServesThem) {
  v1::DescribeShardsResponse before = Describe();
  EXPECT_TRUE(before.has_opening());
  EXPECT_TRUE(before.shards().empty());
  EXPECT_FALSE(before.renderer().empty());
  const absl::Status refused = AskForBox();
  EXPECT_EQ(refused.code(), absl::StatusCode::kUnavailable);
  EXPECT_EQ(base::ReasonOf(refused), base::ErrorReason::kAgentOpening);
  EXPECT_TRUE(base::RetryDelayOf(refused).has_value());

  int settled = 0;
  ISOSCOPE_ASSERT_OK(server_->Open(never_, [&] {
    ++settled;
    before = Describe();
    return absl::OkStatus();
  }));
  EXPECT_EQ(settled, 1);
  EXPECT_EQ(before.opening().shard_count(), 2);
  EXPECT_EQ(before.opening().open_shard_count(), 2);
  EXPECT_EQ(before.opening().read_bytes(), before.opening().table_bytes());
  ASSERT_EQ(before.opening_datasets_size(), 1);
  EXPECT_EQ(before.opening_datasets(0), dataset_.manifest().name);
  const v1::DescribeShardsResponse after = Describe();
  EXPECT_FALSE(after.has_opening());
  EXPECT_TRUE(after.opening_datasets().empty());
  EXPECT_EQ(after.shards_size(), 2);
  EXPECT_EQ(AskForBox(), absl::OkStatus());
}

// Symptom: a poll of a coordinator in the first moments got no name, and callers NOT_FOUND for the
// dataset. Open is not called here: this is what the first answer on the port says.
TEST_F(OpeningAgentTest, TheFirstAnswerNamesTheDatasetsThatWillBeOpened) {
  const v1::DescribeShardsResponse first = Describe();
  ASSERT_EQ(first.opening_datasets_size(), 1);
  EXPECT_EQ(first.opening_datasets(0), dataset_.manifest().name);
  EXPECT_EQ(first.opening().shard_count(), 2);
  EXPECT_EQ(first.opening().open_shard_count(), 0);
  EXPECT_GT(first.opening().table_bytes(), 0);
}

TEST_F(OpeningAgentTest, ShardsAreNotServedIfTheirMemoryDoesNotDo) {
  const absl::Status status =
      server_->Open(never_, [] { return absl::FailedPreconditionError("too little memory"); });
  EXPECT_EQ(status.message(), "too little memory");
  EXPECT_TRUE(Describe().has_opening());
}

TEST_F(OpeningAgentTest, ACancelledOpeningServesNothing) {
  base::Cancellation cancelled;
  cancelled.Cancel();
  EXPECT_TRUE(absl::IsCancelled(server_->Open(cancelled, nullptr)));
  EXPECT_TRUE(Describe().has_opening());
}

class PartitionAgentServiceTest : public ::testing::Test {
 protected:
  void SetUp() override {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(renderer_,
                                  render::MakeRenderer({.kind = render::RendererKind::kCpu}));
    ISOSCOPE_ASSERT_OK(memory_->Settle());
    Start(dataset_.directory());
  }

  void Start(const std::string& directory, int max_concurrent_frames = 4,
             int max_queued_frames = 64, const std::string& listen_address = "") {
    Start(std::vector<std::string>{directory}, max_concurrent_frames, max_queued_frames,
          listen_address);
  }
  void Start(const std::vector<std::string>& directories, int max_concurrent_frames = 4,
             int max_queued_frames = 64, const std::string& listen_address = "") {
    stub_.reset();
    server_.reset();
    AgentServerOptions options;
    options.directories = directories;
    options.listen_address = listen_address;
    options.renderer = renderer_;
    options.arena = arena_;
    options.memory = memory_;
    options.mailboxes = mailboxes_;
    options.sign_of_life_interval = sign_of_life_interval_;
    options.max_concurrent_frames = max_concurrent_frames;
    options.max_queued_frames = max_queued_frames;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(server_, AgentServer::Start(options));
    stub_ = v1::PartitionAgentService::NewStub(
        listen_address.empty() ? server_->InProcessChannel()
                               : rpc::MakeChannel(absl::StrCat("127.0.0.1:", server_->port())));
  }

  v1::RenderFrameRequest Begin(frame::Culling culling = frame::Culling::kDepth) const {
    const FrameTask request = dataset_.Request();
    v1::RenderFrameRequest message;
    v1::BeginFrame* begin = message.mutable_begin();
    begin->set_frame_number(1);
    begin->set_dataset_id(dataset_.manifest().dataset_id);
    begin->add_shard_indices(0);
    begin->add_shard_indices(1);
    frame::FrameSpec spec = request.spec;
    spec.culling = culling;
    *begin->mutable_frame() = wire::ToProto(spec);
    begin->set_agent_count(1);
    begin->set_report_active_blocks(true);
    return message;
  }
  static image::FrameImage EmptyImage() { return {kViewport.width_px, kViewport.height_px}; }
  // Returns the end of a frame that has but one message.
  grpc::Status EndOf(const v1::RenderFrameRequest& message) const {
    FrameCall call(stub_.get());
    call.Send(message);
    return call.Finish();
  }
  // Returns the end of an export, whose blocks `visit` gets.
  template <typename Visit>
  std::string ReadSurface(const v1::ExtractSurfaceRequest& request, const Visit& visit,
                          v1::SurfaceSums* sums = nullptr) const {
    grpc::ClientContext context;
    const auto reader = stub_->ExtractSurface(&context, request);
    v1::ExtractSurfaceResponse message;
    while (reader->Read(&message)) {
      for (const v1::BlockSurface& block : message.blocks()) {
        visit(block);
      }
      if (sums != nullptr && message.has_sums()) {
        *sums = message.sums();
      }
    }
    return CodeOf(reader->Finish());
  }

  // Begins a frame and takes what step 1 found.
  RaySelection BeginAndReadHits(FrameCall* call) const {
    EXPECT_TRUE(call->Send(Begin()));
    v1::RenderFrameResponse message;
    EXPECT_TRUE(call->Read(&message));
    EXPECT_TRUE(message.has_ray_hits()) << message.ShortDebugString();
    auto hits = wire::BlockListFromProto(message.ray_hits().hits(), 1000, "hits");
    auto active = wire::BlockListFromProto(message.ray_hits().active_blocks(), 1000, "active");
    EXPECT_THAT(hits, isoscope::testing::IsOk());
    EXPECT_THAT(active, isoscope::testing::IsOk());
    return {*std::move(hits), *std::move(active)};
  }
  // Steps 2 and 3 of a frame that waits for occluders: the hits, and then what they do not hide.
  void Complete(FrameCall* call, const RaySelection& selection, image::FrameImage* image,
                v1::RenderFrameResponse* last) const {
    EXPECT_TRUE(call->SendOccluders(selection.hits));
    EXPECT_TRUE(call->ReadPixels(image).has_occluders_done());
    const auto [blocks, open_pixels] =
        dataset_.VisibleOf(dataset_.Request(), selection.active, selection.hits, *image);
    EXPECT_FALSE(blocks.empty());
    EXPECT_TRUE(call->SendVisible(blocks, open_pixels));
    *last = call->ReadPixels(image);
  }
  // Waits until the agent takes a frame again: it lets go of an old one when gRPC has.
  void AwaitRoomForAFrame() const {
    while (true) {
      FrameCall call(stub_.get());
      v1::RenderFrameResponse message;
      call.Send(Begin());
      if (call.Read(&message)) {
        EXPECT_TRUE(message.has_ray_hits());
        return;
      }
      ASSERT_EQ(CodeOf(call.Finish()), "RESOURCE_EXHAUSTED");
      absl::SleepFor(absl::Milliseconds(1));
    }
  }

  image::FrameImage Expected() const { return Expected(dataset_.Request()); }
  image::FrameImage Expected(const FrameTask& request,
                             const std::vector<Shards>& color_shards = {}) const {
    const base::Cancellation never;
    BlockCache none(0);
    auto pipeline = FramePipeline::Make(
        dataset_.OpenShards(), request,
        {.renderer = renderer_.get(), .arena = arena_.get(), .cache = &none}, &never, color_shards);
    EXPECT_THAT(pipeline, isoscope::testing::IsOk());
    auto image = (*pipeline)->RenderAll();
    EXPECT_THAT(image, isoscope::testing::IsOk());
    return *std::move(image);
  }

  const SmallDataset dataset_{2};
  std::shared_ptr<render::Renderer> renderer_;
  const std::shared_ptr<base::TaskArena> arena_ = std::make_shared<base::TaskArena>(2);
  const std::shared_ptr<AgentMemory> memory_ = std::make_shared<AgentMemory>(std::size_t{4} << 30);
  std::shared_ptr<image::PixelMailboxes> mailboxes_;  // null: bands
  absl::Duration sign_of_life_interval_ = rpc::kSignOfLifeInterval;
  std::unique_ptr<AgentServer> server_;
  std::unique_ptr<Stub> stub_;
};

TEST_F(PartitionAgentServiceTest, DescribesItsShards) {
  grpc::ClientContext context;
  v1::DescribeShardsResponse response;
  ASSERT_EQ(CodeOf(stub_->DescribeShards(&context, {}, &response)), "OK");
  EXPECT_FALSE(response.version().empty());
  EXPECT_EQ(response.renderer(), renderer_->description());
  const auto shards = dataset_.OpenShards();
  ASSERT_EQ(response.shards_size(), 2);
  for (int i = 0; i < 2; ++i) {
    const v1::ShardDescription& shard = response.shards(i);
    const store::ShardReader& reader = *shards[static_cast<std::size_t>(i)]->reader;
    EXPECT_EQ(shard.dataset().SerializeAsString(),
              wire::ToProto(dataset_.manifest()).SerializeAsString());
    EXPECT_EQ(shard.shard_index(), i);
    EXPECT_EQ(shard.block_count(), reader.block_count());
    EXPECT_EQ(shard.manifest_crc32c(), reader.manifest_crc32c());
    EXPECT_EQ(shard.range_table_crc32c(), dataset_.manifest().range_table_crc32c);
  }
  EXPECT_EQ(server_->shard_summary(), "gyroid 0,1 of 2");
}

TEST_F(PartitionAgentServiceTest, ASmallPictureComesWithTheMessageThatEndsTheStep) {
  FrameCall call(stub_.get());
  ASSERT_TRUE(call.Send(Begin(frame::Culling::kNone)));
  v1::RenderFrameResponse message;
  ASSERT_TRUE(call.Read(&message));
  EXPECT_GT(message.bands_size(), 0);
  EXPECT_TRUE(message.has_frame_done());
}

TEST_F(PartitionAgentServiceTest, ALargePictureComesWholeInMessagesOfAboutAMebibyte) {
  FrameCall call(stub_.get());
  v1::RenderFrameRequest begin = Begin(frame::Culling::kNone);
  begin.mutable_begin()->mutable_frame()->mutable_viewport()->set_width_px(2500);
  begin.mutable_begin()->mutable_frame()->mutable_viewport()->set_height_px(2000);
  ASSERT_TRUE(call.Send(begin));
  image::FrameImage image(2500, 2000);
  int message_count = 0;
  std::size_t bytes = 0;
  v1::RenderFrameResponse message;
  while (!message.has_frame_done()) {
    ASSERT_TRUE(call.Read(&message));
    ++message_count;
    bytes += message.ByteSizeLong();
    EXPECT_TRUE(message.bands_size() == 1 || message.ByteSizeLong() < (std::size_t{11} << 17));
    for (const std::string& band : message.bands()) {
      ISOSCOPE_EXPECT_OK(composite::DecodePixelsInto(band, kOrder, {1, 1}, &image));
    }
  }
  EXPECT_GT(message_count, 1) << bytes << " bytes in one message";
  FrameTask request = dataset_.Request();
  request.spec.viewport = {.width_px = 2500, .height_px = 2000};
  EXPECT_EQ(image, Expected(request));
}

TEST_F(PartitionAgentServiceTest, FrameIsThatOfThePipeline) {
  FrameCall call(stub_.get());
  const RaySelection selection = BeginAndReadHits(&call);
  EXPECT_FALSE(selection.hits.empty());
  EXPECT_FALSE(selection.active.empty());
  image::FrameImage image = EmptyImage();
  v1::RenderFrameResponse last;
  Complete(&call, selection, &image, &last);
  ASSERT_TRUE(last.has_frame_done());
  EXPECT_EQ(CodeOf(call.Finish()), "OK");
  EXPECT_TRUE(image == Expected());
  const auto& statistics = last.frame_done().statistics();
  EXPECT_THAT(statistics.shard_indices(), ElementsAre(0, 1));
  EXPECT_GT(statistics.triangle_count(), 0);
  EXPECT_GT(statistics.read_bytes(), 0);
  EXPECT_TRUE(statistics.agent_address().empty());
}

TEST_F(PartitionAgentServiceTest, FrameWithoutCullingComesAtOnce) {
  FrameCall call(stub_.get());
  ASSERT_TRUE(call.Send(Begin(frame::Culling::kNone)));
  image::FrameImage image = EmptyImage();
  EXPECT_TRUE(call.ReadPixels(&image).has_frame_done());
  EXPECT_EQ(CodeOf(call.Finish()), "OK");
  EXPECT_TRUE(image == Expected());
}

TEST_F(PartitionAgentServiceTest, EveryMessageOutOfOrderIsRefused) {
  v1::RenderFrameRequest occluders;
  occluders.mutable_occluders();
  v1::RenderFrameRequest visible;
  visible.mutable_visible_blocks();
  const v1::RenderFrameRequest nothing;
  const v1::RenderFrameRequest begin = Begin();
  const std::vector<std::vector<v1::RenderFrameRequest>> wrong_in_step = {
      {occluders, visible, nothing}, {begin, visible, nothing}, {begin, occluders, nothing}};
  for (std::size_t step = 0; step < wrong_in_step.size(); ++step) {
    for (std::size_t i = 0; i <= wrong_in_step[step].size(); ++i) {
      SCOPED_TRACE(std::to_string(step) + ", message " + std::to_string(i));
      FrameCall call(stub_.get());
      if (step >= 1) {
        BeginAndReadHits(&call);
      }
      if (step >= 2) {
        call.SkipOccluders();
      }
      if (i < wrong_in_step[step].size()) {
        call.Send(wrong_in_step[step][i]);
      } else {
        call.EndWrites();
      }
      const grpc::Status status = call.Finish();
      EXPECT_EQ(CodeOf(status), "INVALID_ARGUMENT") << status.error_message();
    }
  }
}

TEST_F(PartitionAgentServiceTest, WhatIsNotServedIsAFailedPrecondition) {
  v1::RenderFrameRequest other_dataset = Begin();
  other_dataset.mutable_begin()->set_dataset_id("00000000000000000000000000000000");
  EXPECT_EQ(CodeOf(EndOf(other_dataset)), "FAILED_PRECONDITION");

  Start(dataset_.shard_directory(0));
  const grpc::Status status = EndOf(Begin());
  EXPECT_EQ(CodeOf(status), "FAILED_PRECONDITION");
  EXPECT_THAT(status.error_message(), HasSubstr("shard 1 of dataset \"gyroid\""));
}

TEST_F(PartitionAgentServiceTest, MalformedMessagesAreRefused) {
  std::vector<v1::RenderFrameRequest> bad(6, Begin());
  bad[0].mutable_begin()->mutable_frame()->mutable_surfaces(0)->set_isovalue(
      std::numeric_limits<double>::quiet_NaN());
  bad[1].mutable_begin()->mutable_frame()->clear_camera();
  bad[2].mutable_begin()->mutable_frame()->mutable_viewport()->set_width_px(-1);
  bad[3].mutable_begin()->set_agent_index(1);
  bad[4].mutable_begin()->add_shard_indices(2);
  // A parameter of a newer version, deep in the frame.
  isoscope::v1::Camera* camera = bad[5].mutable_begin()->mutable_frame()->mutable_camera();
  camera->GetReflection()->MutableUnknownFields(camera)->AddVarint(77, 1);
  for (std::size_t i = 0; i < bad.size(); ++i) {
    const grpc::Status status = EndOf(bad[i]);
    EXPECT_EQ(CodeOf(status), "INVALID_ARGUMENT") << i << ": " << status.error_message();
  }
  // Block lists that name no block, name one twice, go back, or would overflow.
  const std::vector<std::vector<std::int64_t>> bad_deltas = {
      {99999},
      {-1},
      {5, 0},
      {5, -2},
      {1, std::numeric_limits<std::int64_t>::max()},
      {std::numeric_limits<std::int64_t>::min()}};
  for (const std::vector<std::int64_t>& deltas : bad_deltas) {
    for (const bool is_visible : {false, true}) {
      FrameCall call(stub_.get());
      BeginAndReadHits(&call);
      v1::RenderFrameRequest message;
      v1::BlockList* list = message.mutable_occluders()->mutable_blocks();
      if (is_visible) {
        call.SkipOccluders();
        list = message.mutable_visible_blocks()->mutable_blocks();
      }
      list->mutable_block_id_deltas()->Assign(deltas.begin(), deltas.end());
      call.Send(message);
      const grpc::Status status = call.Finish();
      EXPECT_EQ(CodeOf(status), "INVALID_ARGUMENT") << deltas.back();
      EXPECT_THAT(status.error_message(),
                  HasSubstr(is_visible ? "visible_blocks.blocks" : "occluders.blocks"));
    }
  }
}

TEST_F(PartitionAgentServiceTest, ColorsComeOfTheDatasetsThatTheFrameNames) {
  const auto make_field = [&](const std::string& directory, std::int64_t edge) {
    const math::Index3& dims = dataset_.geometry().sample_dims;
    const auto source = testing::MakeMemorySource(
        dataset_.geometry(), volume::ScalarType::kFloat32,
        testing::SampleNoise(3, dims, volume::ScalarType::kFloat32, 50), "field");
    partition::PartitionOptions options;
    options.output_directory = directory;
    options.shard_count = 2;
    options.block_cells = {edge, edge, edge};
    return partition::Partition(*source, options, base::Cancellation()).value().dataset_id;
  };
  const testing::TempDir temp;
  const std::string field_id = make_field(temp.Sub("field"), 8);
  const std::string other_cut_id = make_field(temp.Sub("other"), 5);
  Start({dataset_.directory(), temp.Sub("field"), temp.Sub("other")});
  v1::RenderFrameRequest good = Begin(frame::Culling::kNone);
  v1::BeginFrame* const begin = good.mutable_begin();
  begin->mutable_frame()->set_sends_normals(true);
  begin->mutable_frame()->set_sends_map_steps(true);
  begin->mutable_frame()->add_surfaces()->set_isovalue(SmallDataset::kIsovalue + 1);
  isoscope::v1::ColorBy* const color_by =
      begin->mutable_frame()->mutable_surfaces(1)->mutable_color_by();
  color_by->set_quantity(isoscope::v1::ColorBy::QUANTITY_FIELD);
  color_by->set_field("noise");
  color_by->mutable_range()->set_max(50);
  begin->add_color_dataset_ids("");
  begin->add_color_dataset_ids(field_id);
  FrameTask task = dataset_.Request();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(task.spec, wire::FrameSpecFromProto(begin->frame()));
  Shards field_shards;
  for (int i = 0; i < 2; ++i) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        field_shards.emplace_back(),
        OpenShard(temp.Sub("field") + "/" + store::ShardDirectoryName(i, 2)));
  }
  image::FrameImage image = EmptyImage();
  FrameCall call(stub_.get());
  call.Send(good);
  EXPECT_TRUE(call.ReadPixels(&image).has_frame_done());
  EXPECT_TRUE(image == Expected(task, {{}, field_shards}));

  const auto expect = [&](const std::string& code, const std::string& message,
                          const std::function<void(v1::BeginFrame*)>& spoil) {
    v1::RenderFrameRequest bad = good;
    spoil(bad.mutable_begin());
    const grpc::Status status = EndOf(bad);
    EXPECT_EQ(CodeOf(status), code) << status.error_message();
    EXPECT_THAT(status.error_message(), HasSubstr(message));
  };
  expect("INVALID_ARGUMENT", "begin.color_dataset_ids has 1 elements: must have none, or one for",
         [](v1::BeginFrame* bad) { bad->mutable_color_dataset_ids()->RemoveLast(); });
  expect("INVALID_ARGUMENT", "must be empty, because surface 0 shows no other field",
         [&](v1::BeginFrame* bad) { bad->set_color_dataset_ids(0, field_id); });
  expect("INVALID_ARGUMENT", "surface 1 shows another field, but the frame does not name",
         [](v1::BeginFrame* bad) { bad->clear_color_dataset_ids(); });
  expect("INVALID_ARGUMENT", "surfaces[1].color_by.range is not set", [](v1::BeginFrame* bad) {
    bad->mutable_frame()->mutable_surfaces(1)->mutable_color_by()->clear_range();
  });
  expect("FAILED_PRECONDITION", "is not served by this agent",
         [](v1::BeginFrame* bad) { bad->set_color_dataset_ids(1, "nobody"); });
  expect("FAILED_PRECONDITION", "has blocks of 5 x 5 x 5 cells",
         [&](v1::BeginFrame* bad) { bad->set_color_dataset_ids(1, other_cut_id); });
}

TEST_F(PartitionAgentServiceTest, MessagesThatAreDamagedOnTheirWayAreNotTheCoordinatorsFault) {
  v1::RenderFrameRequest damaged;
  proto::ParseChecked(nullptr, &damaged);
  for (const bool has_begun : {false, true}) {
    FrameCall call(stub_.get());
    if (has_begun) {
      BeginAndReadHits(&call);
    }
    call.Send(damaged);
    EXPECT_EQ(CodeOf(call.Finish()), "UNAVAILABLE");
  }
  v1::ExtractSurfaceRequest damaged_surface;
  proto::ParseChecked(nullptr, &damaged_surface);
  EXPECT_EQ(ReadSurface(damaged_surface, [](const v1::BlockSurface&) { ADD_FAILURE(); }),
            "UNAVAILABLE");
}

TEST_F(PartitionAgentServiceTest, CountedBlocksThatAreNoBlocksAreRefused) {
  const auto block_count = static_cast<std::int64_t>(dataset_.layout().block_count());
  for (const auto& deltas :
       {std::vector<std::int64_t>{-1}, {block_count}, {3, 0}, {3, block_count}}) {
    for (const bool is_of_layers : {false, true}) {
      v1::RenderFrameRequest begin = Begin(frame::Culling::kDepth);
      v1::BlockList* const list = is_of_layers
                                      ? begin.mutable_begin()->mutable_counted_layer_blocks()
                                      : begin.mutable_begin()->mutable_counted_blocks();
      list->mutable_block_id_deltas()->Assign(deltas.begin(), deltas.end());
      const grpc::Status status = EndOf(begin);
      EXPECT_EQ(CodeOf(status), "INVALID_ARGUMENT");
      EXPECT_THAT(status.error_message(),
                  HasSubstr(is_of_layers ? "begin.counted_layer_blocks" : "begin.counted_blocks"));
    }
  }
}

TEST_F(PartitionAgentServiceTest, AMailboxOfAnotherProcessIsRefused) {
  v1::RenderFrameRequest begin = Begin(frame::Culling::kNone);
  begin.mutable_begin()->set_mailbox(1);
  const grpc::Status status = EndOf(begin);
  EXPECT_EQ(CodeOf(status), "INVALID_ARGUMENT");
  EXPECT_THAT(status.error_message(), HasSubstr("mailbox is 1"));
}

TEST_F(PartitionAgentServiceTest, PixelsInAMailboxAreThoseOfTheBands) {
  mailboxes_ = image::PixelMailboxes::Make();
  Start(dataset_.directory());
  const auto mailbox = mailboxes_->Open();
  v1::RenderFrameRequest begin = Begin(frame::Culling::kNone);
  begin.mutable_begin()->set_mailbox(mailbox->number());
  FrameCall call(stub_.get());
  ASSERT_TRUE(call.Send(begin));
  image::FrameImage no_bands = EmptyImage();
  const v1::RenderFrameResponse last = call.ReadPixels(&no_bands);
  EXPECT_TRUE(last.has_frame_done());
  EXPECT_TRUE(last.pixels_are_in_mailbox());
  EXPECT_TRUE(no_bands == EmptyImage());
  const std::optional<image::DrawnPixels> pixels = mailbox->Take();
  ASSERT_TRUE(pixels.has_value());
  EXPECT_TRUE(pixels->image == Expected());
  EXPECT_EQ(mailbox->Take(), std::nullopt);
}

TEST_F(PartitionAgentServiceTest, AFrameWhoseMailboxIsClosedEnds) {
  mailboxes_ = image::PixelMailboxes::Make();
  Start(dataset_.directory());
  v1::RenderFrameRequest begin = Begin(frame::Culling::kNone);
  begin.mutable_begin()->set_mailbox(mailboxes_->Open()->number());  // closes it
  EXPECT_EQ(CodeOf(EndOf(begin)), "CANCELLED");
}

TEST_F(PartitionAgentServiceTest, BlocksOfAnotherAgentAreRefused) {
  for (const bool is_visible : {false, true}) {
    // Both shards' blocks to an agent that was asked for the first one alone.
    FrameCall both(stub_.get());
    const RaySelection selection = BeginAndReadHits(&both);
    FrameCall call(stub_.get());
    v1::RenderFrameRequest begin = Begin();
    begin.mutable_begin()->mutable_shard_indices()->RemoveLast();
    call.Send(begin);
    v1::RenderFrameResponse message;
    ASSERT_TRUE(call.Read(&message));
    if (is_visible) {
      call.SkipOccluders();
      call.SendVisible(selection.active, "");
    } else {
      call.SendOccluders(selection.active);
    }
    const grpc::Status status = call.Finish();
    EXPECT_EQ(CodeOf(status), "INVALID_ARGUMENT");
    EXPECT_THAT(status.error_message(), HasSubstr("not active blocks of this agent"));
  }
}

TEST_F(PartitionAgentServiceTest, ActiveBlocksAreReportedOnlyIfAskedFor) {
  v1::RenderFrameRequest begin = Begin();
  begin.mutable_begin()->set_report_active_blocks(false);
  FrameCall call(stub_.get());
  call.Send(begin);
  v1::RenderFrameResponse message;
  ASSERT_TRUE(call.Read(&message));
  EXPECT_GT(message.ray_hits().hits().block_id_deltas_size(), 0);
  EXPECT_EQ(message.ray_hits().active_blocks().block_id_deltas_size(), 0);
}

TEST_F(PartitionAgentServiceTest, DamagedOpenPixelsAreDataLoss) {
  // Rubbish, and sound masks of no block.
  for (const std::string& open_pixels :
       {std::string("rubbish"), std::string(1000, '\xff'), visibility::EncodeOpenPixels({})}) {
    FrameCall call(stub_.get());
    const RaySelection selection = BeginAndReadHits(&call);
    call.SkipOccluders();
    call.SendVisible(selection.active, open_pixels);
    EXPECT_EQ(CodeOf(call.Finish()), "DATA_LOSS");
  }
}

TEST_F(PartitionAgentServiceTest, CancelledFrameEndsAndMakesRoom) {
  for (int step = 0; step < 3; ++step) {
    Start(dataset_.directory(), 1, 0);  // room for one frame
    {
      FrameCall call(stub_.get());
      BeginAndReadHits(&call);
      if (step >= 1) {
        call.SendOccluders({});
      }
      image::FrameImage image = EmptyImage();
      if (step >= 2) {
        EXPECT_TRUE(call.ReadPixels(&image).has_occluders_done());
      }
      call.Cancel();
      EXPECT_EQ(CodeOf(call.Finish()), "CANCELLED");
    }
    AwaitRoomForAFrame();
  }
}

// Nothing is measured by it.
constexpr absl::Duration kHangGuard = absl::Seconds(60);

// Draws nothing: a pass ends when its frame is cancelled.
class HangingRenderer final : public render::Renderer {
 public:
  absl::StatusOr<std::unique_ptr<render::RenderPass>> BeginPass(
      const view::View& /*view*/, const volume::BlockLayout& /*layout*/,
      const frame::FrameSpec& /*spec*/) override {
    return std::make_unique<Pass>(this);
  }
  [[nodiscard]] frame::PictureRevision picture_revision() const override { return {}; }
  [[nodiscard]] std::string description() const override { return "hangs"; }

  absl::Notification begun;
  absl::Notification cancelled;

 private:
  class Pass final : public render::RenderPass {
   public:
    explicit Pass(HangingRenderer* renderer) : renderer_(*renderer) {}
    absl::Status Add(std::span<const render::MeshToDraw> /*meshes*/) override {
      return absl::OkStatus();
    }
    absl::StatusOr<image::FrameImage> Finish(const base::Cancellation& cancellation) override {
      const base::Cancellation::Callback on_cancel(cancellation,
                                                   [this] { renderer_.cancelled.Notify(); });
      renderer_.begun.Notify();
      renderer_.cancelled.WaitForNotificationWithTimeout(2 * kHangGuard);
      return absl::CancelledError("as told");
    }

   private:
    HangingRenderer& renderer_;
  };
};

TEST_F(PartitionAgentServiceTest, AFrameThatFailsStopsItsStepWhichWouldComputeForNobody) {
  const auto renderer = std::make_shared<HangingRenderer>();
  renderer_ = renderer;
  Start(dataset_.directory(), 1, 0);
  FrameCall call(stub_.get());
  ASSERT_TRUE(call.Send(Begin(frame::Culling::kNone)));
  ASSERT_TRUE(renderer->begun.WaitForNotificationWithTimeout(kHangGuard));
  ASSERT_TRUE(call.SendOccluders({}));  // nobody asked for it
  const grpc::Status status = call.Finish();
  EXPECT_EQ(CodeOf(status), "INVALID_ARGUMENT");
  EXPECT_THAT(status.error_message(), HasSubstr("no message was expected"));
  EXPECT_TRUE(renderer->cancelled.WaitForNotificationWithTimeout(kHangGuard));
}

TEST_F(PartitionAgentServiceTest, MoreFramesThanAllowedAreRefused) {
  Start(dataset_.directory(), 1, 1);
  FrameCall first(stub_.get());
  const RaySelection selection = BeginAndReadHits(&first);
  FrameCall second(stub_.get());
  BeginAndReadHits(&second);
  {
    const grpc::Status status = EndOf(Begin());
    EXPECT_EQ(CodeOf(status), "RESOURCE_EXHAUSTED");
    EXPECT_THAT(status.error_message(), HasSubstr("retry later"));
    EXPECT_TRUE(base::RetryDelayOf(rpc::ToAbslStatus(status)).has_value());
  }
  // Those in work are not disturbed, and the end of one makes room.
  image::FrameImage image = EmptyImage();
  v1::RenderFrameResponse last;
  Complete(&first, selection, &image, &last);
  EXPECT_TRUE(last.has_frame_done());
  EXPECT_EQ(CodeOf(first.Finish()), "OK");
  EXPECT_TRUE(image == Expected());
  AwaitRoomForAFrame();
}

// Symptom: an agent cast all rays of a band before it said that it had no memory for it.
TEST_F(PartitionAgentServiceTest, AFrameAboveTheLimitIsTooLargeBeforeItsRaysAreCast) {
  v1::RenderFrameRequest large = Begin();
  isoscope::v1::Viewport* const viewport =
      large.mutable_begin()->mutable_frame()->mutable_viewport();
  viewport->set_width_px(16384);
  viewport->set_height_px(16384);
  FrameCall call(stub_.get());
  EXPECT_TRUE(call.Send(large));
  v1::RenderFrameResponse answer;
  EXPECT_FALSE(call.Read(&answer)) << answer.ShortDebugString();
  const absl::Status status = rpc::ToAbslStatus(call.Finish());
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_THAT(status.message(), HasSubstr("16384 x 16384 pixels needs"));
  EXPECT_EQ(base::ReasonOf(status), base::ErrorReason::kTooLarge);
}

TEST_F(PartitionAgentServiceTest, ShutdownWithGraceFinishesTheFrameInWork) {
  // gRPC's in-process transport knows no grace: it cuts its calls at once.
  Start(dataset_.directory(), 4, 64, "127.0.0.1:0");
  FrameCall call(stub_.get());
  const RaySelection selection = BeginAndReadHits(&call);
  std::thread shutdown([&] { server_->Shutdown(absl::Minutes(2)); });
  image::FrameImage image = EmptyImage();
  v1::RenderFrameResponse last;
  Complete(&call, selection, &image, &last);
  EXPECT_TRUE(last.has_frame_done());
  EXPECT_EQ(CodeOf(call.Finish()), "OK");
  EXPECT_TRUE(image == Expected());
  shutdown.join();
}

TEST_F(PartitionAgentServiceTest, AnAgentThatStopsLetsInNothingNew) {
  Start(dataset_.directory(), 4, 64, "127.0.0.1:0");
  FrameCall call(stub_.get());
  const RaySelection selection = BeginAndReadHits(&call);
  std::jthread shutdown([&] { server_->Shutdown(absl::Minutes(2)); });
  v1::DescribeShardsResponse described;
  while (!described.is_draining()) {
    grpc::ClientContext context;
    ASSERT_EQ(CodeOf(stub_->DescribeShards(&context, {}, &described)), "OK");
  }
  FrameCall other(stub_.get());
  v1::RenderFrameResponse message;
  EXPECT_TRUE(other.Send(Begin()));
  EXPECT_FALSE(other.Read(&message));
  EXPECT_EQ(CodeOf(other.Finish()), "UNAVAILABLE");
  EXPECT_EQ(ReadSurface({}, [](const v1::BlockSurface&) {}), "UNAVAILABLE");
  grpc::ClientContext context;
  v1::GetShardHistogramResponse histogram;
  EXPECT_EQ(CodeOf(stub_->GetShardHistogram(&context, {}, &histogram)), "UNAVAILABLE");
  image::FrameImage image = EmptyImage();
  Complete(&call, selection, &image, &message);
  EXPECT_TRUE(message.has_frame_done());
  EXPECT_EQ(CodeOf(call.Finish()), "OK");
  EXPECT_TRUE(image == Expected());
  shutdown.join();
}

// Symptom: it waited for the frame's other calls after its client had left.
TEST_F(PartitionAgentServiceTest, AFrameThatNoCallFollowsHasEndedForAnAgentThatStops) {
  Start(dataset_.directory(), 4, 64, "127.0.0.1:0");
  constexpr char kRequest[] = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01";
  const auto code_of = [&](const v1::RenderFrameRequest& message) {
    FrameCall call(stub_.get(), kRequest);
    EXPECT_TRUE(call.Send(message));
    return CodeOf(call.Finish());
  };
  v1::RenderFrameRequest begin = Begin(frame::Culling::kNone);
  begin.mutable_begin()->set_frame_number(17);
  begin.mutable_begin()->set_others_follow(true);
  EXPECT_EQ(code_of(begin), "OK");
  while (server_->frames_in_work() > 0) {
    absl::SleepFor(absl::Milliseconds(1));
  }
  v1::RenderFrameRequest end;
  end.mutable_begin()->set_frame_number(17);
  EXPECT_EQ(code_of(end), "OK");
  FrameCall other(stub_.get());
  const RaySelection selection = BeginAndReadHits(&other);
  std::jthread shutdown([&] { server_->Shutdown(absl::Minutes(2)); });
  v1::DescribeShardsResponse described;
  while (!described.is_draining()) {
    grpc::ClientContext context;
    ASSERT_EQ(CodeOf(stub_->DescribeShards(&context, {}, &described)), "OK");
  }
  EXPECT_EQ(code_of(begin), "UNAVAILABLE");
  image::FrameImage image = EmptyImage();
  v1::RenderFrameResponse last;
  Complete(&other, selection, &image, &last);
  EXPECT_EQ(CodeOf(other.Finish()), "OK");
  shutdown.join();
}

TEST_F(PartitionAgentServiceTest, TheEndOfAFrameIsNoMessageOfItsStream) {
  FrameCall call(stub_.get());
  BeginAndReadHits(&call);
  v1::RenderFrameRequest end;
  end.mutable_begin()->set_frame_number(17);
  EXPECT_TRUE(call.Send(end));
  EXPECT_EQ(CodeOf(call.Finish()), "INVALID_ARGUMENT");
}

TEST_F(PartitionAgentServiceTest, ShutdownWithoutGraceCancelsTheFrameInWork) {
  Start(dataset_.directory(), 4, 64, "127.0.0.1:0");
  FrameCall call(stub_.get());
  BeginAndReadHits(&call);
  server_->Shutdown(absl::ZeroDuration());
  EXPECT_THAT(CodeOf(call.Finish()), AnyOf("CANCELLED", "UNAVAILABLE"));
}

v1::ExtractSurfaceRequest SurfaceOf(const SmallDataset& dataset, const std::vector<int>& shards) {
  v1::ExtractSurfaceRequest request;
  request.set_dataset_id(dataset.manifest().dataset_id);
  request.mutable_shard_indices()->Assign(shards.begin(), shards.end());
  request.set_isovalue(SmallDataset::kIsovalue);
  return request;
}

// The bytes of a block's surface, as messages have them.
std::string BytesOf(const mesh::BlockMesh& mesh) {
  const auto append = [](const auto& values, std::string* bytes) {
    bytes->append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(values[0]));
  };
  std::string bytes;
  append(mesh.positions, &bytes);
  append(mesh.normals, &bytes);
  append(mesh.copies, &bytes);
  append(mesh.indices, &bytes);
  return bytes;
}

// The surfaces of all blocks, and their sums.
std::map<std::int64_t, std::string> ExpectedSurface(const SmallDataset& dataset,
                                                    const solid::SurfaceOptions& options,
                                                    solid::SurfaceSums* sums) {
  const volume::BlockLayout layout = dataset.layout();
  solid::BlockSurface extractor(dataset.geometry(), layout,
                                std::make_shared<extract::BlockShapes>(layout), options);
  std::map<std::int64_t, std::string> blocks;
  for (std::int64_t i = 0; i < layout.block_count(); ++i) {
    const auto id = static_cast<volume::BlockId>(i);
    const std::string samples =
        isoscope::testing::CutBlock(layout, volume::ScalarType::kUint8, dataset.samples(), id);
    mesh::BlockMesh mesh;
    extractor.Extract({id, volume::ScalarType::kUint8, samples.data()},
                      volume::InsideRule::OfIsovalue(SmallDataset::kIsovalue), &mesh, sums);
    if (!mesh.indices.empty()) {
      blocks[i] = BytesOf(mesh);
    }
  }
  return blocks;
}

TEST_F(PartitionAgentServiceTest, SurfacesOfAllShardsAreThoseOfAllBlocks) {
  isoscope::v1::ClipRegion region;
  region.add_half_spaces()->mutable_normal()->set_x(1);
  region.mutable_half_spaces(0)->set_offset(12);
  const view::ClipRegion clip{.half_spaces = {{{1, 0, 0}, 12}}, .box = {}};
  for (const auto& [closes, is_cut] : {std::pair(false, false), {true, false}, {true, true}}) {
    std::map<std::int64_t, std::string> blocks;
    solid::SurfaceSums sums;
    for (const std::vector<int>& shards : std::vector<std::vector<int>>{{0}, {1}}) {
      v1::ExtractSurfaceRequest request = SurfaceOf(dataset_, shards);
      request.set_closes(closes);
      if (is_cut) {
        *request.mutable_clip() = region;
      }
      std::int64_t last = -1;
      const auto visit = [&](const v1::BlockSurface& block) {
        EXPECT_GT(block.block_id(), last) << "blocks must ascend";
        last = block.block_id();
        blocks[last] = block.positions() + block.normals() + block.copies() + block.triangles();
      };
      v1::SurfaceSums shard_sums;
      EXPECT_EQ(ReadSurface(request, visit, &shard_sums), "OK");
      sums.Add({.area = math::ExactSum::Decode(shard_sums.area()).value(),
                .volume = math::ExactSum::Decode(shard_sums.volume()).value(),
                .triangle_count = shard_sums.triangle_count(),
                .open_side_count = shard_sums.open_edge_count()});
      request.set_without_blocks(true);
      v1::SurfaceSums alone;
      EXPECT_EQ(ReadSurface(
                    request, [](const v1::BlockSurface&) { ADD_FAILURE(); }, &alone),
                "OK");
      EXPECT_EQ(alone.SerializeAsString(), shard_sums.SerializeAsString());
    }
    solid::SurfaceSums expected_sums;
    const std::map<std::int64_t, std::string> expected = ExpectedSurface(
        dataset_, {.clip = is_cut ? clip : view::ClipRegion(), .closes = closes}, &expected_sums);
    EXPECT_TRUE(blocks == expected) << blocks.size() << " and " << expected.size() << " blocks";
    EXPECT_EQ(sums.area.Value(), expected_sums.area.Value());
    EXPECT_EQ(sums.volume.Value(), expected_sums.volume.Value());
    EXPECT_EQ(sums.triangle_count, expected_sums.triangle_count);
    EXPECT_EQ(sums.open_side_count, expected_sums.open_side_count);
    EXPECT_EQ(sums.open_side_count == 0, closes);
  }
}

// Symptom: sums that took longer than the coordinator waits for a message ended as an agent that is
// silent. The interval is 0: each batch tells life, unless the sign before it is on its way.
TEST_F(PartitionAgentServiceTest, BatchesWithNothingToSendTellThatTheAgentWorks) {
  const SmallDataset large(1, {177, 177, 177});
  for (const bool tells : {true, false}) {
    sign_of_life_interval_ = tells ? absl::ZeroDuration() : absl::Hours(1);
    Start(large.directory());
    v1::ExtractSurfaceRequest request = SurfaceOf(large, {0});
    request.set_without_blocks(true);
    grpc::ClientContext context;
    const auto reader = stub_->ExtractSurface(&context, request);
    v1::ExtractSurfaceResponse message;
    int sign_count = 0;
    bool has_sums = false;
    while (reader->Read(&message)) {
      EXPECT_THAT(proto::CheckIntact(message), isoscope::testing::IsOk());
      EXPECT_FALSE(has_sums) << "they come last";
      has_sums = message.has_sums();
      sign_count += has_sums ? 0 : 1;
      EXPECT_EQ(message.blocks_size(), 0);
    }
    EXPECT_EQ(CodeOf(reader->Finish()), "OK");
    EXPECT_TRUE(has_sums);
    if (tells) {
      EXPECT_GT(sign_count, 0);
    } else {
      EXPECT_EQ(sign_count, 0);
    }
  }
}

// Symptom: an export that waited for others longer than the coordinator waits for a message ended
// as one of an agent that is silent.
TEST_F(PartitionAgentServiceTest, ExtractionsThatWaitForOthersTellThatTheAgentWorks) {
  const SmallDataset large(1, {241, 241, 241});
  sign_of_life_interval_ = absl::Milliseconds(20);
  Start(large.directory());
  const v1::ExtractSurfaceRequest request = SurfaceOf(large, {0});
  struct Slow {  // nobody reads it on, so that its task waits
    grpc::ClientContext context;
    std::unique_ptr<grpc::ClientReader<v1::ExtractSurfaceResponse>> reader;
  };
  std::vector<std::unique_ptr<Slow>> slow;
  for (int i = 0; i < AgentContext::kMaxConcurrentExtractions; ++i) {
    slow.push_back(std::make_unique<Slow>());
    slow.back()->reader = stub_->ExtractSurface(&slow.back()->context, request);
    v1::ExtractSurfaceResponse first;
    while (slow.back()->reader->Read(&first) && first.blocks_size() == 0) {
    }
    ASSERT_GT(first.blocks_size(), 0);
  }
  v1::ExtractSurfaceRequest sums_alone = request;
  sums_alone.set_without_blocks(true);
  grpc::ClientContext context;
  const auto reader = stub_->ExtractSurface(&context, sums_alone);
  v1::ExtractSurfaceResponse message;
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(reader->Read(&message)) << reader->Finish().error_message();
    EXPECT_THAT(proto::CheckIntact(message), isoscope::testing::IsOk());
    ASSERT_FALSE(message.has_sums()) << "it did not wait";
  }
  for (const auto& one : slow) {
    one->context.TryCancel();
    EXPECT_EQ(CodeOf(one->reader->Finish()), "CANCELLED");
  }
  while (reader->Read(&message)) {
  }
  EXPECT_TRUE(message.has_sums());
  EXPECT_EQ(CodeOf(reader->Finish()), "OK");
}

// Blocks of 8 cells: a plane at x = 12 leaves out the first of each row, and cuts the second.
TEST_F(PartitionAgentServiceTest, BlocksOutsideOfTheRegionAreNotSentAndThoseInsideComeWhole) {
  const auto blocks_of = [&](const v1::ExtractSurfaceRequest& request) {
    std::map<std::int64_t, std::string> blocks;
    EXPECT_EQ(ReadSurface(request,
                          [&](const v1::BlockSurface& block) {
                            blocks[block.block_id()] = block.SerializeAsString();
                          }),
              "OK");
    return blocks;
  };
  const auto begin_of = [&](std::int64_t block) {
    return dataset_.layout().CellsOf(static_cast<volume::BlockId>(block)).begin.x;
  };
  v1::ExtractSurfaceRequest request = SurfaceOf(dataset_, {0, 1});
  const std::map<std::int64_t, std::string> all = blocks_of(request);
  isoscope::v1::HalfSpace* const half_space = request.mutable_clip()->add_half_spaces();
  half_space->mutable_normal()->set_x(1);
  half_space->set_offset(12);
  int cut_count = 0;
  for (const auto& [id, bytes] : blocks_of(request)) {
    EXPECT_GT(begin_of(id), 0);
    if (begin_of(id) == 8) {
      EXPECT_NE(bytes, all.at(id));
      ++cut_count;
    } else {
      EXPECT_EQ(bytes, all.at(id));
    }
  }
  EXPECT_GT(cut_count, 0);
  half_space->set_offset(1000);
  EXPECT_TRUE(blocks_of(request).empty());
}

TEST_F(PartitionAgentServiceTest, BadSurfaceRequestsAreRefused) {
  std::vector<std::pair<v1::ExtractSurfaceRequest, std::string>> cases;
  cases.emplace_back(SurfaceOf(dataset_, {0}), "INVALID_ARGUMENT");
  cases.back().first.set_isovalue(std::numeric_limits<double>::infinity());
  cases.emplace_back(SurfaceOf(dataset_, {0}), "FAILED_PRECONDITION");
  cases.back().first.set_dataset_id("other");
  cases.emplace_back(SurfaceOf(dataset_, {1, 0}), "INVALID_ARGUMENT");
  cases.emplace_back(SurfaceOf(dataset_, {0}), "INVALID_ARGUMENT");
  cases.back().first.mutable_clip()->add_half_spaces();
  for (const auto& [request, code] : cases) {
    EXPECT_EQ(ReadSurface(request, [](const v1::BlockSurface&) { ADD_FAILURE(); }), code)
        << request.ShortDebugString();
  }
}

TEST_F(PartitionAgentServiceTest, GradientsComeFromTheShardsAndBadQuestionsAreRefused) {
  v1::GetGradientsRequest request;
  request.set_dataset_id(dataset_.manifest().dataset_id);
  for (int i = 0; i < 100; ++i) {
    request.add_points()->set_x(0.4 * i);
    request.add_block_ids(i % 2 == 0 ? i : -1);
  }
  const auto ask = [&](const v1::GetGradientsRequest& asked, v1::GetGradientsResponse* response) {
    grpc::ClientContext context;
    return CodeOf(stub_->GetGradients(&context, asked, response));
  };
  int count = 0;
  std::set<int> told;  // points whose block's shard an agent told
  for (const int shard : {0, 1}) {
    request.clear_shard_indices();
    request.add_shard_indices(shard);
    v1::GetGradientsResponse response;
    EXPECT_EQ(ask(request, &response), "OK");
    for (const v1::PointGradient& gradient : response.gradients()) {
      ++count;
      EXPECT_GE(gradient.point_index(), 0);
      EXPECT_LT(gradient.point_index(), 100);
    }
    for (const v1::PointShard& point : response.shards()) {
      EXPECT_EQ(point.shard_index(), shard);
      EXPECT_EQ(point.point_index() % 2, 0) << "nobody asked for its block";
      EXPECT_TRUE(told.insert(point.point_index()).second) << "two shards have it";
    }
  }
  EXPECT_EQ(count, 100);
  EXPECT_EQ(told.size(), 50U);

  // The values of the dataset itself, which are the isovalue on a surface.
  v1::GetGradientsRequest with_values = request;
  with_values.mutable_values()->add_dataset_ids(request.dataset_id());
  for (int i = 0; i < request.points_size(); ++i) {
    with_values.mutable_values()->add_isovalues(SmallDataset::kIsovalue);
    with_values.add_on_caps(false);
  }
  v1::GetGradientsResponse values;
  EXPECT_EQ(ask(with_values, &values), "OK");
  EXPECT_EQ(values.values_size(), values.shards_size()) << "points whose blocks lie in the shard";
  for (const v1::PointValues& point : values.values()) {
    EXPECT_EQ(point.values_size(), 1);
  }

  std::vector<std::pair<v1::GetGradientsRequest, std::string>> cases(10, {request, ""});
  cases[8].first = with_values;
  cases[8].first.mutable_values()->add_isovalues(1);
  cases[9].first = with_values;
  cases[9].first.mutable_values()->add_dataset_ids("other");
  cases[9].second = "FAILED_PRECONDITION";
  cases[0].first.set_dataset_id("other");
  cases[0].second = "FAILED_PRECONDITION";
  cases[1].first.clear_shard_indices();
  cases[2].first.mutable_points(7)->set_z(std::numeric_limits<double>::quiet_NaN());
  for (int i = 0; i < 901; ++i) {
    cases[3].first.add_points();
    cases[3].first.add_block_ids(-1);
  }
  cases[4].first.GetReflection()->MutableUnknownFields(&cases[4].first)->AddVarint(90, 1);
  cases[5].first.add_block_ids(0);
  cases[6].first.set_block_ids(3, -2);
  cases[7].first.set_block_ids(3, dataset_.layout().block_count());
  for (const auto& [bad, code] : cases) {
    v1::GetGradientsResponse response;
    EXPECT_EQ(ask(bad, &response), code.empty() ? "INVALID_ARGUMENT" : code);
  }
}

// Symptom: queries for the values of labels, which read all samples, kept histograms and picks
// waiting. These are answered while most of the queries still wait.
TEST_F(PartitionAgentServiceTest, HistogramsAndPicksDoNotWaitForQueriesOfLabels) {
  const SmallDataset large(1, {97, 97, 97});
  Start(large.directory());
  v1::GetShardHistogramRequest histogram;
  histogram.set_dataset_id(large.manifest().dataset_id);
  histogram.add_shard_indices(0);
  histogram.set_max_bin_count(16);
  v1::GetShardHistogramRequest labels = histogram;
  labels.set_max_label_value_count(static_cast<std::int32_t>(volume::kMaxListedValues));
  v1::GetGradientsRequest pick;
  pick.set_dataset_id(large.manifest().dataset_id);
  pick.add_shard_indices(0);
  pick.add_points();
  pick.add_block_ids(-1);
  // Fewer may be in the queue than a machine under load does before the histogram comes.
  bool came_early = false;
  for (int query_count = 16; !came_early && query_count <= AgentContext::kMaxQueuedLabelQueries;
       query_count *= 2) {
    std::atomic<int> done{0};
    std::vector<std::thread> clients;
    for (int i = 0; i < query_count; ++i) {
      clients.emplace_back([&] {
        grpc::ClientContext context;
        v1::GetShardHistogramResponse response;
        EXPECT_EQ(CodeOf(stub_->GetShardHistogram(&context, labels, &response)), "OK");
        ++done;
      });
    }
    while (done == 0) {  // so the others are in the queue
      absl::SleepFor(absl::Milliseconds(1));
    }
    grpc::ClientContext first_context;
    v1::GetShardHistogramResponse counts;
    EXPECT_EQ(CodeOf(stub_->GetShardHistogram(&first_context, histogram, &counts)), "OK");
    grpc::ClientContext second_context;
    v1::GetGradientsResponse gradients;
    EXPECT_EQ(CodeOf(stub_->GetGradients(&second_context, pick, &gradients)), "OK");
    came_early = done < query_count - 5;  // else behind all queries but two
    for (std::thread& client : clients) {
      client.join();
    }
  }
  EXPECT_TRUE(came_early) << "the histogram and the pick waited for queries of labels";
}

TEST_F(PartitionAgentServiceTest, SlowReaderHoldsTheAgentBackAndCancellingEndsIt) {
  // More surface than the agent queues: it waits for its reader.
  const SmallDataset large(1, {177, 177, 177});
  Start(large.directory(), 1, 0);
  std::size_t bytes = 0;
  for (const bool is_cancelled : {true, false}) {
    grpc::ClientContext context;
    const auto reader = stub_->ExtractSurface(&context, SurfaceOf(large, {0}));
    v1::ExtractSurfaceResponse message;
    ASSERT_TRUE(reader->Read(&message));
    absl::SleepFor(absl::Milliseconds(200));  // lets the agent run into its limit
    if (is_cancelled) {
      context.TryCancel();
    }
    bytes = message.ByteSizeLong();
    while (reader->Read(&message)) {
      bytes += message.ByteSizeLong();
    }
    EXPECT_EQ(CodeOf(reader->Finish()), is_cancelled ? "CANCELLED" : "OK");
  }
  EXPECT_GT(bytes, std::size_t{9} << 20) << "too small a surface to fill the agent's queue";
  server_->Shutdown(absl::Minutes(2));
}

}  // namespace
}  // namespace isoscope::agent
