// Frames that a coordinator or an agent has no memory for at once, in clusters of real processes:
// they are drawn in bands, and have the bytes of a cluster with ample memory. What the bands share
// is counted once. What can't be drawn in bands is refused with a limit that draws. Agents that stop
// finish all bands of a frame.

#include <algorithm>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <future>
#include <memory>
#include <regex>
#include <string>
#include <utility>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "google/protobuf/util/message_differencer.h"
#include "gtest/gtest.h"
#include <grpcpp/client_context.h>

#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "isoscope/v1/interact_service.grpc.pb.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"
#include "tests/support/enough_time.h"
#include "tests/support/process.h"
#include "tests/support/process_cluster.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "wire/response_splitter.h"

namespace isoscope {
namespace {

namespace v1 = isoscope::v1;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using testing::StatusIs;

constexpr int kShardCounts[] = {1, 2, 5};
using Flags = std::vector<std::string>;
Flags LittleMemory() { return {"--memory-limit", "96MiB"}; }
// An agent has its shards and its libraries besides, and margins of effects.
Flags LittleMemoryOfAgent() { return {"--memory-limit", "160MiB"}; }

struct Cluster {
  std::vector<testing::ServerProcess> agents;
  testing::ServerProcess coordinator;
};

class BandsTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    shared_ = new testing::TempDir();
    for (const int shard_count : kShardCounts) {
      ISOSCOPE_ASSERT_OK(testing::MakeDataset(testing::GyroidVolume({43, 37, 29}),
                                              Dataset(shard_count), shard_count, 8));
    }
  }
  static void TearDownTestSuite() {
    delete shared_;
    shared_ = nullptr;
  }
  static void StopAgentsBetweenBands(bool* is_in_time);
  static std::string Dataset(int shard_count) {
    return shared_->Sub(absl::StrCat("d", shard_count));
  }

  static absl::StatusOr<std::unique_ptr<Cluster>> Start(int shard_count,
                                                        const Flags& coordinator_flags = {},
                                                        const Flags& agent_flags = {}) {
    auto cluster = std::make_unique<Cluster>();
    std::vector<std::string> addresses;
    for (int shard = 0; shard < shard_count; ++shard) {
      ISOSCOPE_ASSIGN_OR_RETURN(
          testing::ServerProcess agent,
          testing::StartAgent({testing::ShardDirectory(Dataset(shard_count), shard, shard_count)},
                              "127.0.0.1:0", agent_flags));
      addresses.push_back(agent.address);
      cluster->agents.push_back(std::move(agent));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(cluster->coordinator,
                              testing::StartCoordinator(addresses, coordinator_flags));
    return cluster;
  }

  static absl::StatusOr<v1::RenderIsosurfaceResponse> Render(
      const Cluster& cluster, const v1::RenderIsosurfaceRequest& request) {
    return testing::Render(cluster.coordinator.address, request);
  }

  static absl::StatusOr<v1::RenderIsosurfaceResponse> RenderStream(
      const Cluster& cluster, const v1::RenderIsosurfaceRequest& request) {
    const auto stub =
        v1::IsosurfaceService::NewStub(rpc::MakeFreshChannel(cluster.coordinator.address));
    grpc::ClientContext context;
    context.set_deadline(base::MonotonicNow() + testing::kPatience);
    v1::RenderIsosurfaceStreamRequest in_parts;
    *in_parts.mutable_request() = request;
    const auto reader = stub->RenderIsosurfaceStream(&context, in_parts);
    v1::RenderIsosurfaceStreamResponse message;
    v1::RenderIsosurfaceResponse response;
    while (reader->Read(&message)) {
      wire::AppendPart(message.part(), &response);
    }
    const absl::Status status = rpc::ToAbslStatus(reader->Finish());
    return status.ok() ? absl::StatusOr<v1::RenderIsosurfaceResponse>(response) : status;
  }

  // The gyroid from beside: parts of it lie outside of the picture, and behind others.
  static v1::RenderIsosurfaceRequest RequestOf(int width, int height) {
    v1::RenderIsosurfaceRequest request = testing::SmallRequest();
    request.mutable_viewport()->set_width_px(width);
    request.mutable_viewport()->set_height_px(height);
    v1::Camera* const camera = request.mutable_camera();
    camera->mutable_eye()->set_x(90);
    camera->mutable_eye()->set_y(60);
    camera->mutable_eye()->set_z(70);
    camera->mutable_target()->set_x(21);
    camera->mutable_target()->set_y(18);
    camera->mutable_target()->set_z(14);
    camera->mutable_up()->set_y(1);
    camera->mutable_perspective()->set_fov_y_degrees(22);
    return request;
  }

  static v1::Surface* AddSurface(double isovalue, float alpha,
                                 v1::RenderIsosurfaceRequest* request) {
    request->clear_isovalue();
    v1::Surface* const surface = request->add_surfaces();
    surface->set_isovalue(isovalue);
    surface->mutable_color()->set_red(0.9F);
    surface->mutable_color()->set_green(static_cast<float>(std::min(isovalue / 255, 1.0)));
    surface->mutable_color()->set_alpha(alpha);
    return surface;
  }

  // Frames that 96 MiB are too little for, and that are drawn in bands with them: samples, layers,
  // effects with margins, cuts, colours, planes, regions, and each format.
  static std::vector<std::pair<std::string, v1::RenderIsosurfaceRequest>> LargeRequests() {
    std::vector<std::pair<std::string, v1::RenderIsosurfaceRequest>> requests;
    const auto add = [&](const std::string& name, const v1::RenderIsosurfaceRequest& request) {
      requests.emplace_back(name, request);
      return &requests.back().second;
    };
    add("samples", RequestOf(420, 330))->set_samples(16);
    v1::RenderIsosurfaceRequest layers = RequestOf(400, 340);
    AddSurface(128, 1, &layers);
    AddSurface(100, 0.4F, &layers);
    AddSurface(150, 0.6F, &layers);
    layers.set_max_layers(2);
    layers.set_samples(9);
    add("layers", layers);
    layers.mutable_ambient_occlusion()->set_radius_px(40);
    layers.mutable_ambient_occlusion()->set_strength(1);
    layers.mutable_silhouette()->set_width_px(3);
    add("layers and effects", layers);
    layers.mutable_background_color()->set_alpha(0.5F);
    add("translucent background", layers);
    layers.clear_background_color();
    layers.mutable_region()->set_x(31);
    layers.mutable_region()->set_y(17);
    layers.mutable_region()->set_width_px(350);
    layers.mutable_region()->set_height_px(300);
    add("region", layers);
    v1::RenderIsosurfaceRequest cut = RequestOf(420, 330);
    AddSurface(128, 1, &cut)
        ->mutable_color_by()
        ->set_quantity(v1::ColorBy::QUANTITY_GRADIENT_MAGNITUDE);
    cut.mutable_clip()->add_half_spaces()->mutable_normal()->set_x(1);
    cut.mutable_clip()->mutable_half_spaces(0)->set_offset(15);
    cut.mutable_caps()->set_color_map(v1::COLOR_MAP_TURBO);
    cut.add_lights()->mutable_direction()->set_x(1);
    cut.set_samples(16);
    add("cut", cut);
    cut.mutable_caps()->mutable_range()->mutable_percentiles()->set_high(90);
    cut.mutable_surfaces(0)->mutable_color_by()->mutable_range()->set_source(
        v1::ColorRange::SOURCE_VISIBLE);
    add("cut with a window, coloured by what is visible", cut);
    cut.mutable_caps()->mutable_range()->Clear();
    cut.mutable_caps()->mutable_range()->set_source(v1::ColorRange::SOURCE_VISIBLE);
    add("cut of what is visible", cut);
    v1::RenderIsosurfaceRequest planes = RequestOf(840, 720);
    planes.mutable_output()->set_depth(true);
    planes.mutable_output()->set_surface_index(true);
    planes.mutable_output()->set_position(true);
    planes.mutable_output()->set_normal(true);
    planes.mutable_output()->set_depth_bounds(true);
    add("planes", planes);
    planes.mutable_silhouette()->set_width_px(2);
    planes.mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_RGBA8);
    add("planes and raw picture", planes);
    v1::RenderIsosurfaceRequest jpeg = RequestOf(420, 330);
    jpeg.set_samples(16);
    jpeg.set_culling(v1::CULLING_NONE);
    jpeg.mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_JPEG);
    add("JPEG without culling", jpeg);
    return requests;
  }

  static void ExpectSamePicture(const v1::RenderIsosurfaceResponse& banded,
                                const v1::RenderIsosurfaceResponse& whole) {
    EXPECT_TRUE(banded.png() == whole.png());
    EXPECT_TRUE(banded.jpeg() == whole.jpeg());
    EXPECT_TRUE(banded.rgba8() == whole.rgba8());
    EXPECT_TRUE(banded.depth() == whole.depth());
    EXPECT_TRUE(banded.surface_index() == whole.surface_index());
    EXPECT_TRUE(banded.position() == whole.position());
    EXPECT_TRUE(banded.normal() == whole.normal());
    EXPECT_TRUE(banded.depth_bounds() == whole.depth_bounds());
    using google::protobuf::util::MessageDifferencer;
    EXPECT_TRUE(MessageDifferencer::Equals(banded.camera(), whole.camera()));
    EXPECT_TRUE(MessageDifferencer::Equals(banded.extent(), whole.extent()));
    ASSERT_EQ(banded.colorings_size(), whole.colorings_size());
    for (int i = 0; i < banded.colorings_size(); ++i) {
      EXPECT_TRUE(MessageDifferencer::Equals(banded.colorings(i), whole.colorings(i)));
    }
    EXPECT_TRUE(MessageDifferencer::Equals(banded.caps_coloring(), whole.caps_coloring()));
    EXPECT_EQ(banded.statistics().truncated_pixel_count(),
              whole.statistics().truncated_pixel_count());
  }

  // `all`: the statistics of the same frame at once, without culling
  static void ExpectDistinctCounts(const v1::RenderStatistics& banded,
                                   const v1::RenderStatistics& all, bool is_culled) {
    EXPECT_EQ(banded.active_block_count(), all.active_block_count());
    std::int64_t triangles = 0;
    std::int64_t blocks = 0;
    for (const v1::AgentStatistics& agent : banded.agents()) {
      triangles += agent.triangle_count();
      blocks += agent.visible_block_count();
    }
    EXPECT_EQ(triangles, banded.triangle_count());
    EXPECT_EQ(blocks, banded.visible_block_count());
    if (!is_culled) {
      EXPECT_EQ(banded.triangle_count(), all.triangle_count());
      EXPECT_EQ(banded.unique_vertex_count(), all.unique_vertex_count());
      EXPECT_EQ(banded.visible_block_count(), all.visible_block_count());
      return;
    }
    EXPECT_GT(banded.triangle_count(), 0);
    EXPECT_LE(banded.triangle_count(), all.triangle_count());
    EXPECT_LE(banded.unique_vertex_count(), all.unique_vertex_count());
    EXPECT_GT(banded.occluding_block_count(), 0);
    EXPECT_LE(banded.occluding_block_count(), banded.visible_block_count());
    EXPECT_LE(banded.visible_block_count(), banded.active_block_count());
    ASSERT_EQ(banded.surfaces_size(), all.surfaces_size());
    for (int i = 0; i < banded.surfaces_size(); ++i) {
      EXPECT_LE(banded.surfaces(i).triangle_count(), all.surfaces(i).triangle_count()) << i;
    }
  }

  static testing::TempDir* shared_;
};

testing::TempDir* BandsTest::shared_ = nullptr;

TEST_F(BandsTest, LittleMemoryGivesTheBytesOfAmpleMemoryForAnyAgents) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<Cluster> ample, Start(2));
  std::vector<v1::RenderIsosurfaceResponse> whole;
  std::vector<v1::RenderStatistics> all;
  for (auto& [name, request] : LargeRequests()) {
    SCOPED_TRACE(name);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(v1::RenderIsosurfaceResponse response, Render(*ample, request));
    EXPECT_EQ(response.statistics().band_count(), 1);
    whole.push_back(std::move(response));
    request.set_culling(v1::CULLING_NONE);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(response, Render(*ample, request));
    all.push_back(response.statistics());
  }
  for (const auto& [shard_count, agents_have_little] :
       {std::pair(1, false), {5, false}, {2, true}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const std::unique_ptr<Cluster> little,
        Start(shard_count, LittleMemory(), agents_have_little ? LittleMemoryOfAgent() : Flags()));
    const auto requests = LargeRequests();
    for (std::size_t i = 0; i < requests.size(); ++i) {
      SCOPED_TRACE(absl::StrCat(requests[i].first, ", ", shard_count, " agents, ",
                                agents_have_little ? "with little memory" : "with ample memory"));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse banded,
                                    Render(*little, requests[i].second));
      EXPECT_GT(banded.statistics().band_count(), 1);
      ExpectSamePicture(banded, whole[i]);
      ExpectDistinctCounts(banded.statistics(), all[i],
                           requests[i].second.culling() != v1::CULLING_NONE);
      if (shard_count == 1) {
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse streamed,
                                      RenderStream(*little, requests[i].second));
        ExpectSamePicture(streamed, whole[i]);
      }
    }
  }
}

// An agent waits this long for the next band of a frame, once it stops (BegunFrames::kBetweenCalls).
constexpr absl::Duration kBetweenCalls = absl::Seconds(5);

// `is_in_time` becomes false if the machine may have needed longer than that.
void BandsTest::StopAgentsBetweenBands(bool* is_in_time) {
  v1::RenderIsosurfaceRequest request = RequestOf(420, 330);
  request.set_samples(16);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::unique_ptr<Cluster> ample,
      Start(2, {}, {"--drain-notice-seconds", "0", "--drain-seconds", "3600"}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse whole, Render(*ample, request));
  // A coordinator with little memory, whose first band waits for the first agent.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const testing::ServerProcess held,
      testing::StartHoldingAgent(ample->agents[0].address, "visible_blocks"));
  Cluster little;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      little.coordinator,
      testing::StartCoordinator({held.address, ample->agents[1].address}, LittleMemory()));
  const base::MonotonicTime begin = base::MonotonicNow();
  std::future<absl::StatusOr<v1::RenderIsosurfaceResponse>> frame =
      std::async(std::launch::async, [&] {
        // So that the agents' end below does not come from the frame's deadline.
        return testing::Render(little.coordinator.address, request, 10 * testing::kPatience);
      });
  const absl::Cleanup release = [&] { held.process->Signal(SIGUSR1); };
  ISOSCOPE_ASSERT_OK(held.process->WaitForErrLine("holding"));
  for (const testing::ServerProcess& agent : ample->agents) {
    agent.process->Signal(SIGTERM);
    ISOSCOPE_ASSERT_OK(agent.process->WaitForErrLine("agent_finishes_frames"));
  }
  EXPECT_THAT(Render(*ample, request),
              StatusIs(absl::StatusCode::kUnavailable, HasSubstr("the agent stops")));
  // The second agent has done its part of the band. It waits for the next one, for longer than after a
  // last call (BegunFrames::kAfterLastCall).
  absl::SleepFor(absl::Milliseconds(1500));
  held.process->Signal(SIGUSR1);
  absl::StatusOr<v1::RenderIsosurfaceResponse> drawn = frame.get();
  if (!drawn.ok() && base::MonotonicNow() - begin >= kBetweenCalls) {
    *is_in_time = false;  // so the second agent may have given up the next band
    return;
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse banded, std::move(drawn));
  EXPECT_GT(banded.statistics().band_count(), 1);
  ExpectSamePicture(banded, whole);
  for (const testing::ServerProcess& agent : ample->agents) {
    // Long before the grace time ends: the last band says that it is the last.
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const int exit_code, agent.process->Wait(testing::kPatience));
    EXPECT_EQ(exit_code, 0);
  }
}

// Symptom: agents that got SIGTERM ended the band in work and refused the next one, so that a job of
// Slurm that was cancelled lost its large frames.
TEST_F(BandsTest, AgentsThatStopFinishAllBandsOfAFrameAndRefuseOthers) {
  testing::WithEnoughTime(kBetweenCalls, [](absl::Duration /*limit*/) {
    bool is_in_time = true;
    StopAgentsBetweenBands(&is_in_time);
    return is_in_time || HasFatalFailure();
  });
}

// Symptom: regions that were drawn in bands had none.
TEST_F(BandsTest, NotesOnSurfacesAreThoseOfAmpleMemory) {
  v1::RenderIsosurfaceRequest seen = RequestOf(480, 360);
  seen.set_samples(16);
  seen.set_with_notes(true);
  AddSurface(128, 1, &seen);
  AddSurface(1000, 1, &seen);  // of no sample
  v1::RenderIsosurfaceRequest outside = seen;
  outside.mutable_camera()->mutable_target()->set_x(900);
  v1::RenderIsosurfaceRequest clipped = seen;
  clipped.mutable_clip()->add_half_spaces()->mutable_normal()->set_x(1);
  clipped.mutable_clip()->mutable_half_spaces(0)->set_offset(900);
  std::vector<v1::RenderIsosurfaceRequest> requests = {seen, outside, clipped};
  for (v1::RenderIsosurfaceRequest region : {seen, outside, clipped}) {
    region.mutable_region()->set_x(20);
    region.mutable_region()->set_y(10);
    region.mutable_region()->set_width_px(440);
    region.mutable_region()->set_height_px(340);
    requests.push_back(region);
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<Cluster> ample, Start(2));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<Cluster> little, Start(2, LittleMemory()));
  for (std::size_t i = 0; i < requests.size(); ++i) {
    SCOPED_TRACE(i);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse whole,
                                  Render(*ample, requests[i]));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse banded,
                                  Render(*little, requests[i]));
    EXPECT_EQ(whole.statistics().band_count(), 1);
    EXPECT_GT(banded.statistics().band_count(), 1);
    ASSERT_EQ(whole.notes_size(), i % 3 == 0 ? 1 : 2);
    ASSERT_EQ(banded.notes_size(), whole.notes_size());
    for (int k = 0; k < whole.notes_size(); ++k) {
      EXPECT_EQ(banded.notes(k).SerializeAsString(), whole.notes(k).SerializeAsString());
    }
  }
}

// The coordinator learns the limit of agents elsewhere from their refusals.
TEST_F(BandsTest, AgentsWithoutMemoryForTheWholeGetBandsAndAreInNoTrouble) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<Cluster> ample, Start(2));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<Cluster> little,
                                Start(2, {}, LittleMemoryOfAgent()));
  const v1::RenderIsosurfaceRequest request = RequestOf(1500, 1300);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse whole, Render(*ample, request));
  for (int i = 0; i < 2; ++i) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse banded,
                                  Render(*little, request));
    EXPECT_GT(banded.statistics().band_count(), 1);
    ExpectSamePicture(banded, whole);
  }
  // The mask is drawn at once or not at all.
  v1::RenderIsosurfaceRequest masked = request;
  masked.set_culling(v1::CULLING_MASK);
  EXPECT_THAT(Render(*little, masked),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("--memory-limit")));
}

TEST_F(BandsTest, AViewAtRestHasTheBytesAndTheDepthsOfTheWhole) {
  v1::RenderIsosurfaceRequest request = RequestOf(420, 330);
  request.set_samples(16);
  request.mutable_silhouette()->set_width_px(2);
  std::vector<v1::InteractResponse> answers;
  for (const Flags& flags : {Flags(), LittleMemory()}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<Cluster> cluster, Start(2, flags));
    const auto stub =
        v1::InteractService::NewStub(rpc::MakeFreshChannel(cluster->coordinator.address));
    grpc::ClientContext context;
    context.set_deadline(base::MonotonicNow() + testing::kPatience);
    const auto stream = stub->Interact(&context);
    v1::InteractRequest state;
    state.mutable_view_state()->set_sequence_number(1);
    *state.mutable_view_state()->mutable_frame() = request;
    state.mutable_view_state()->set_is_at_rest(true);
    ASSERT_TRUE(stream->Write(state));
    v1::InteractResponse response;
    do {
      ASSERT_TRUE(stream->Read(&response));
      ASSERT_FALSE(response.has_error()) << response.error().message();
    } while (!response.is_exact());
    context.TryCancel();
    answers.push_back(response);
  }
  EXPECT_EQ(answers[0].frame().statistics().band_count(), 1);
  EXPECT_GT(answers[1].frame().statistics().band_count(), 1);
  EXPECT_TRUE(answers[1].frame().png() == answers[0].frame().png());
  EXPECT_GT(answers[0].depth_grid().width(), 0);
  EXPECT_TRUE(google::protobuf::util::MessageDifferencer::Equals(answers[1].depth_grid(),
                                                                 answers[0].depth_grid()));
}

TEST_F(BandsTest, FramesOfAFilmAreThoseOfAmpleMemory) {
  const auto film = [&](const std::string& name, const Flags& more) {
    Flags arguments = {"render", Dataset(2), "--isovalue", "128", "--samples", "16"};
    for (const auto& [flag, value] : {std::pair("--width", std::string("560")),
                                      {"--height", "420"},
                                      {"--repeat", "3"},
                                      {"--orbit", "25"},
                                      {"--renderer", "cpu"},
                                      {"--output", shared_->Sub(name + "-%d.png")},
                                      {"--stats", shared_->Sub(name + ".json")}}) {
      arguments.insert(arguments.end(), {flag, value});
    }
    arguments.push_back("--no-metadata");
    arguments.insert(arguments.end(), more.begin(), more.end());
    return testing::RunIsoscope(arguments);
  };
  const testing::CommandResult ample = film("ample", {});
  ASSERT_EQ(ample.exit_code, 0) << ample.err;
  EXPECT_THAT(ample.out, Not(HasSubstr("bands")));
  const testing::CommandResult little = film("little", {"--memory-limit", "160MiB"});
  ASSERT_EQ(little.exit_code, 0) << little.err;
  EXPECT_THAT(little.out, HasSubstr("3 frames were drawn in "));
  for (int i = 0; i < 3; ++i) {
    const auto read = [&](const std::string& name) {
      return io::ReadWholeFile(shared_->Sub(absl::StrCat(name, "-", i, ".png")), 1 << 24);
    };
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string whole, read("ample"));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string banded, read("little"));
    EXPECT_TRUE(banded == whole) << i;
  }
}

// A part that is lost between two bands is lost for all of them.
TEST_F(BandsTest, APartialPictureLacksTheSameShardsInAllBands) {
  std::vector<v1::RenderIsosurfaceResponse> answers;
  for (const Flags& flags : {Flags(), LittleMemory()}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<Cluster> cluster, Start(5, flags));
    cluster->agents[3].process->Kill();
    v1::RenderIsosurfaceRequest request = RequestOf(420, 330);
    request.set_samples(16);
    EXPECT_THAT(Render(*cluster, request),
                StatusIs(absl::StatusCode::kUnavailable, HasSubstr("3")));
    request.set_allow_partial(true);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response,
                                  Render(*cluster, request));
    ASSERT_EQ(response.statistics().missing_shards_size(), 1);
    EXPECT_EQ(response.statistics().missing_shards(0), 3);
    answers.push_back(response);
  }
  EXPECT_GT(answers[1].statistics().band_count(), 1);
  ExpectSamePicture(answers[1], answers[0]);
  EXPECT_EQ(answers[1].statistics().active_block_coverage(),
            answers[0].statistics().active_block_coverage());
}

TEST_F(BandsTest, WhatDoesNotFitInBandsIsRefusedWithALimitThatDraws) {
  v1::RenderIsosurfaceRequest request = RequestOf(1200, 1000);
  request.mutable_output()->set_position(true);
  request.mutable_output()->set_normal(true);
  request.set_samples(4);
  absl::Status refused;
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<Cluster> little, Start(1, LittleMemory()));
    refused = Render(*little, request).status();
    EXPECT_THAT(refused, StatusIs(absl::StatusCode::kResourceExhausted,
                                  AllOf(HasSubstr("also in bands"), HasSubstr("fewer planes"))));
    v1::RenderIsosurfaceRequest masked = RequestOf(1600, 1600);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse banded,
                                  Render(*little, masked));
    EXPECT_GT(banded.statistics().band_count(), 1);
    masked.set_culling(v1::CULLING_MASK);
    EXPECT_THAT(Render(*little, masked),
                StatusIs(absl::StatusCode::kResourceExhausted, Not(HasSubstr("in bands"))));
  }
  std::smatch found;
  const std::string sentence(refused.message());
  ASSERT_TRUE(std::regex_search(sentence, found, std::regex("--memory-limit to (\\d+)MiB")));
  int enough = 0;
  ASSERT_TRUE(absl::SimpleAtoi(found[1].str(), &enough));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<Cluster> named,
                                Start(1, {"--memory-limit", absl::StrCat(enough, "MiB")}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse banded, Render(*named, request));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<Cluster> ample, Start(1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse whole, Render(*ample, request));
  ExpectSamePicture(banded, whole);
}

TEST_F(BandsTest, AgentsWithOpenGlGiveTheBytesOfTheirOwnWhole) {
  v1::RenderIsosurfaceRequest request = RequestOf(420, 330);
  request.set_samples(16);
  std::vector<v1::RenderIsosurfaceResponse> answers;
  for (const Flags& flags : {Flags(), LittleMemory()}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<Cluster> cluster,
                                  Start(2, flags, {"--renderer", "egl"}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(v1::RenderIsosurfaceResponse response, Render(*cluster, request));
    answers.push_back(std::move(response));
  }
  EXPECT_GT(answers[1].statistics().band_count(), 1);
  ExpectSamePicture(answers[1], answers[0]);
}

}  // namespace
}  // namespace isoscope
