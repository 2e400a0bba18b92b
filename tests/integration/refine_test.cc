// Views that refine, in clusters of real processes:
//
// - tiles have the bytes of RenderIsosurface for their regions, and the last frame those of the whole;
// - a coarser level comes first, what is nearest to the focus next;
// - limits defer the exact frame; another picture ends it; the same one goes on;
// - the coarse frame has a quality of its own; other clients have their turn between tiles;
// - an agent that is killed in between gives an error or the right pixels;
// - clients that do not ask for it get what they got before.
//
// Small volumes are drawn too quickly to be refined. So each stream first draws the same surfaces with
// many samples: the coordinator then expects the next exact frame to take as long.

#include <algorithm>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <google/protobuf/util/message_differencer.h>
#include <grpcpp/client_context.h>

#include "core/base/monotonic_time.h"
#include "core/image/jpeg_codec.h"
#include "isoscope/v1/cluster_service.grpc.pb.h"
#include "isoscope/v1/interact_service.grpc.pb.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"
#include "tests/support/level_files.h"
#include "tests/support/process_cluster.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "wire/proto_convert.h"

namespace isoscope {
namespace {

namespace v1 = isoscope::v1;
using ::google::protobuf::util::MessageDifferencer;
using ::testing::AnyOf;
using ::testing::HasSubstr;
using testing::ProcessCluster;
using testing::StatusIs;

constexpr absl::Duration kLimit = absl::Minutes(5);
constexpr int kShardCount = 2;
constexpr int kHighest = 2;

// Slow enough that a part of it is slow, too.
constexpr absl::Duration kSlow = absl::Milliseconds(800);

// Those of JPEGs (docs/interactive.md): of coarse frames at rest, of moving views.
constexpr int kRestQuality = 95;
constexpr int kMovingQuality = 85;

// The quantisation tables of a JPEG, which its quality decides.
std::string QuantisationOf(const std::string& jpeg) {
  std::string tables;
  // Segments up to the scan: a marker, then the length of the rest in two bytes.
  for (std::size_t i = 2; i + 4 <= jpeg.size() && jpeg[i + 1] != '\xDA';) {
    const std::size_t length = std::size_t{static_cast<unsigned char>(jpeg[i + 2])} * 256 +
                               static_cast<unsigned char>(jpeg[i + 3]);
    tables += jpeg[i + 1] == '\xDB' ? jpeg.substr(i + 4, length - 2) : "";
    i += 2 + length;
  }
  return tables;
}
std::string QuantisationOf(int quality) {
  const std::vector<image::Rgba8> pixels(64);
  const absl::StatusOr<std::string> jpeg = image::EncodeJpeg(8, 8, pixels, {}, quality);
  ISOSCOPE_EXPECT_OK(jpeg.status());
  return QuantisationOf(*jpeg);
}

v1::Refinement All() {
  v1::Refinement refinement;
  refinement.set_coarse_levels(true);
  refinement.set_tiles(true);
  return refinement;
}

// What came for a picture, until its exact frame, its error or its deferral.
struct Answers {
  std::vector<v1::InteractResponse> coarse;
  std::vector<v1::InteractResponse> tiles;
  std::optional<v1::InteractResponse> last;  // none: the stream has ended
};

// A client of one stream, whose views rest.
class Viewer {
 public:
  explicit Viewer(const std::string& address)
      : stub_(v1::InteractService::NewStub(rpc::MakeFreshChannel(address))) {
    context_.set_deadline(base::MonotonicNow() + kLimit);
    stream_ = stub_->Interact(&context_);
  }
  ~Viewer() { context_.TryCancel(); }

  // Without `refinement` as an old client. Returns the number of the state.
  std::int64_t Send(const v1::RenderIsosurfaceRequest& frame,
                    const std::optional<v1::Refinement>& refinement, bool is_at_rest = true) {
    v1::InteractRequest request;
    v1::ViewState& state = *request.mutable_view_state();
    state.set_sequence_number(++sequence_);
    *state.mutable_frame() = frame;
    state.set_is_at_rest(is_at_rest);
    if (refinement.has_value()) {
      *state.mutable_refinement() = *refinement;
    }
    EXPECT_TRUE(stream_->Write(request));
    return sequence_;
  }
  std::optional<v1::InteractResponse> ReadOnly() {
    v1::InteractResponse response;
    return stream_->Read(&response) ? std::optional(std::move(response)) : std::nullopt;
  }
  void Acknowledge(const v1::InteractResponse& response,
                   absl::Duration decode = absl::ZeroDuration()) {
    if (!response.has_error() && !response.has_exact_deferred()) {
      v1::InteractRequest request;
      request.mutable_frame_shown()->set_frame_number(response.frame_number());
      *request.mutable_frame_shown()->mutable_decode_duration() = wire::ToProto(decode);
      stream_->Write(request);
    }
  }
  // Reads and acknowledges one answer.
  std::optional<v1::InteractResponse> Read() {
    std::optional<v1::InteractResponse> response = ReadOnly();
    if (response.has_value()) {
      Acknowledge(*response);
    }
    return response;
  }
  // Reads the answers of a state. Those of states before it are passed over.
  Answers ReadAll(std::int64_t sequence,
                  const std::function<void(const v1::InteractResponse&)>& on_tile = nullptr) {
    Answers answers;
    while (std::optional<v1::InteractResponse> response = Read()) {
      if (response->sequence_number() < sequence) {
        continue;
      }
      if (response->has_tile()) {
        answers.tiles.push_back(*response);
        if (on_tile != nullptr) {
          on_tile(*response);
        }
      } else if (response->has_frame() && !response->is_exact()) {
        answers.coarse.push_back(*std::move(response));
      } else {
        answers.last = std::move(response);
        break;
      }
    }
    return answers;
  }

 private:
  std::unique_ptr<v1::InteractService::Stub> stub_;
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::InteractRequest, v1::InteractResponse>> stream_;
  std::int64_t sequence_ = 0;
};

class RefineTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    shared_ = new testing::TempDir();
    const testing::TestVolume volume = testing::GyroidVolume({67, 59, 53});
    ISOSCOPE_ASSERT_OK(testing::MakeDataset(volume, Dataset(), kShardCount, 8));
    ISOSCOPE_ASSERT_OK(
        testing::AddLevelFiles(Dataset(), volume.samples, kHighest, volume::LevelFilter::kMean)
            .status());
  }
  static void TearDownTestSuite() {
    delete shared_;
    shared_ = nullptr;
  }
  static std::string Dataset() { return shared_->Sub("dataset"); }

  void Start(const std::vector<std::string>& coordinator_flags = {}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(cluster_,
                                  ProcessCluster::Start(Dataset(), kShardCount, coordinator_flags));
  }

  // Views on a circle around the volume.
  static v1::RenderIsosurfaceRequest FrameOf(int view) {
    v1::RenderIsosurfaceRequest request = testing::SmallRequest();
    request.mutable_viewport()->set_width_px(701);
    request.mutable_viewport()->set_height_px(560);
    v1::Camera* const camera = request.mutable_camera();
    camera->mutable_eye()->set_x(150 - view);
    camera->mutable_eye()->set_y(90 + view);
    camera->mutable_eye()->set_z(110);
    camera->mutable_target()->set_x(33);
    camera->mutable_target()->set_y(29);
    camera->mutable_target()->set_z(26);
    camera->mutable_up()->set_y(1);
    camera->mutable_perspective()->set_fov_y_degrees(26);
    return request;
  }

  // Opaque, layers with effects and samples, a cut with caps, a named level, omitted ranges.
  static std::vector<std::pair<std::string, v1::RenderIsosurfaceRequest>> Requests() {
    std::vector<std::pair<std::string, v1::RenderIsosurfaceRequest>> requests;
    requests.emplace_back("opaque", FrameOf(0));
    v1::RenderIsosurfaceRequest layers = FrameOf(1);
    layers.clear_isovalue();
    for (const double isovalue : {128.0, 100.0, 150.0}) {
      v1::Surface* const surface = layers.add_surfaces();
      surface->set_isovalue(isovalue);
      surface->mutable_color()->set_red(0.9F);
      surface->mutable_color()->set_alpha(isovalue == 128 ? 1.0F : 0.4F);
    }
    layers.set_samples(4);
    layers.mutable_ambient_occlusion();
    layers.mutable_silhouette();
    layers.mutable_background_color()->set_alpha(1);
    requests.emplace_back("layers", layers);
    v1::RenderIsosurfaceRequest cut = FrameOf(2);
    cut.mutable_clip()->add_half_spaces()->mutable_normal()->set_x(-1);
    cut.mutable_clip()->mutable_half_spaces(0)->set_offset(-41);
    cut.mutable_caps()->set_color_map(v1::COLOR_MAP_TURBO);
    requests.emplace_back("cut", cut);
    v1::RenderIsosurfaceRequest level = FrameOf(3);
    level.mutable_level()->set_level(1);
    requests.emplace_back("level 1", level);
    v1::RenderIsosurfaceRequest ranges = FrameOf(4);
    ranges.clear_isovalue();
    v1::Surface* const gradient = ranges.add_surfaces();
    gradient->set_isovalue(128);
    gradient->mutable_color_by()->set_quantity(v1::ColorBy::QUANTITY_POSITION_Y);
    ranges.set_with_notes(true);
    requests.emplace_back("position", ranges);
    return requests;
  }

  // Draws the surfaces of a frame so slowly that the next frame of them is expected to be slow.
  static void MakeSlow(Viewer* viewer, v1::RenderIsosurfaceRequest frame) {
    frame.set_samples(16);
    frame.mutable_ambient_occlusion();
    absl::Duration took;
    for (int side_px = 1200; took < kSlow; side_px += 200) {
      ASSERT_LE(side_px, 2048) << "this machine is too fast for the test";
      frame.mutable_viewport()->set_width_px(side_px);
      frame.mutable_viewport()->set_height_px(side_px);
      const base::MonotonicTime begin = base::MonotonicNow();
      const Answers answers = viewer->ReadAll(viewer->Send(frame, v1::Refinement()));
      ASSERT_TRUE(answers.last.has_value());
      ASSERT_TRUE(answers.last->is_exact()) << answers.last->error().message();
      took = base::MonotonicNow() - begin;
    }
  }

  [[nodiscard]] std::string Render(const v1::RenderIsosurfaceRequest& request) const {
    const auto response = testing::Render(cluster_->address(), request, kLimit);
    ISOSCOPE_EXPECT_OK(response.status());
    return response.ok() ? response->png() : "";
  }

  // Expects that a tile has the bytes of its region.
  void ExpectRight(const v1::RenderIsosurfaceRequest& request, const v1::Tile& tile) const {
    v1::RenderIsosurfaceRequest of_region = request;
    *of_region.mutable_region() = tile.region();
    EXPECT_TRUE(tile.png() == Render(of_region)) << tile.region().ShortDebugString();
  }

  static inline testing::TempDir* shared_ = nullptr;
  std::unique_ptr<ProcessCluster> cluster_;
};

TEST_F(RefineTest, TilesAndTheirFrameHaveTheBytesOfRenderIsosurface) {
  Start();
  for (const auto& [name, request] : Requests()) {
    SCOPED_TRACE(name);
    Viewer viewer(cluster_->address());
    ASSERT_NO_FATAL_FAILURE(MakeSlow(&viewer, request));
    const Answers answers = viewer.ReadAll(viewer.Send(request, All()));
    ASSERT_TRUE(answers.last.has_value());
    ASSERT_TRUE(answers.last->is_exact()) << answers.last->error().message();
    const v1::RenderIsosurfaceResponse& exact = answers.last->frame();

    ASSERT_EQ(answers.coarse.size(), 1U);
    const v1::RenderIsosurfaceResponse& coarse = answers.coarse[0].frame();
    EXPECT_FALSE(coarse.jpeg().empty());
    EXPECT_GT(coarse.drawn_level().level(), exact.drawn_level().level());
    EXPECT_EQ(coarse.extent().width_px(), request.viewport().width_px()) << "of full size";

    ASSERT_GT(answers.tiles.size(), 1U);
    std::int64_t pixel_count = 0;
    for (std::size_t i = 0; i < answers.tiles.size(); ++i) {
      const v1::Tile& tile = answers.tiles[i].tile();
      EXPECT_EQ(tile.index(), static_cast<int>(i));
      EXPECT_EQ(tile.count(), static_cast<int>(answers.tiles.size()));
      EXPECT_TRUE(MessageDifferencer::Equals(tile.camera(), exact.camera()));
      EXPECT_TRUE(MessageDifferencer::Equals(tile.drawn_level(), exact.drawn_level()));
      EXPECT_TRUE(MessageDifferencer::Equals(tile.extent(), exact.extent()));
      pixel_count += std::int64_t{tile.region().width_px()} * tile.region().height_px();
      ExpectRight(request, tile);
    }
    EXPECT_EQ(pixel_count, std::int64_t{701} * 560) << "each pixel in one tile";

    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse whole,
                                  testing::Render(cluster_->address(), request, kLimit));
    EXPECT_TRUE(exact.png() == whole.png());
    EXPECT_EQ(exact.statistics().active_block_count(), whole.statistics().active_block_count());
    EXPECT_EQ(exact.statistics().band_count(), static_cast<int>(answers.tiles.size()));
    EXPECT_EQ(exact.notes_size(), whole.notes_size());
    EXPECT_EQ(exact.colorings_size(), whole.colorings_size());
    EXPECT_GT(answers.last->depth_grid().width(), 0);
  }
}

TEST_F(RefineTest, TheTileAtTheFocusComesFirst) {
  Start();
  Viewer viewer(cluster_->address());
  for (const auto& [x, y] : {std::pair(0.02, 0.02), std::pair(0.98, 0.98), std::pair(0.98, 0.02)}) {
    ASSERT_NO_FATAL_FAILURE(MakeSlow(&viewer, FrameOf(0)));
    v1::Refinement refinement = All();
    refinement.mutable_focus()->set_x(x);
    refinement.mutable_focus()->set_y(y);
    const Answers answers =
        viewer.ReadAll(viewer.Send(FrameOf(static_cast<int>(10 * x + y)), refinement));
    ASSERT_FALSE(answers.tiles.empty());
    const v1::Region& first = answers.tiles.front().tile().region();
    EXPECT_LE(first.x(), 701 * x);
    EXPECT_LE(701 * x, first.x() + first.width_px());
    EXPECT_LE(first.y(), 560 * y);
    EXPECT_LE(560 * y, first.y() + first.height_px());
  }
}

TEST_F(RefineTest, AFrameOverALimitIsDeferredUntilTheLimitIsRaised) {
  Start();
  Viewer viewer(cluster_->address());
  v1::Refinement limited = All();
  limited.set_max_exact_bytes(1);
  v1::RenderIsosurfaceRequest counted = FrameOf(0);
  counted.set_with_unresolved_count(true);
  const std::int64_t first = viewer.Send(counted, limited);
  const Answers deferred = viewer.ReadAll(first);
  ASSERT_TRUE(deferred.last.has_value());
  ASSERT_TRUE(deferred.last->has_exact_deferred());
  ASSERT_EQ(deferred.coarse.size(), 1U) << "what is shown instead";
  EXPECT_GT(deferred.last->exact_deferred().expected_bytes(), 1000);
  EXPECT_TRUE(MessageDifferencer::Equals(deferred.last->exact_deferred().drawn_level(),
                                         deferred.coarse[0].frame().drawn_level()));
  EXPECT_TRUE(deferred.coarse[0].frame().statistics().has_unresolved_block_count())
      << "it stays, so it says what it hides";

  const std::int64_t second = viewer.Send(counted, All());
  const Answers exact = viewer.ReadAll(second);
  ASSERT_TRUE(exact.last.has_value());
  ASSERT_TRUE(exact.last->is_exact());
  EXPECT_EQ(exact.last->sequence_number(), second);
  EXPECT_TRUE(exact.coarse.empty()) << "it is there";
  EXPECT_TRUE(exact.last->frame().png() == Render(FrameOf(0)));

  v1::Refinement of_time = All();
  *of_time.mutable_max_exact_duration() = google::protobuf::Duration();
  const Answers in_no_time = viewer.ReadAll(viewer.Send(FrameOf(1), of_time));
  ASSERT_TRUE(in_no_time.last.has_value());
  EXPECT_TRUE(in_no_time.last->has_exact_deferred());
}

// Symptom: a page lets the server choose its first camera. "Draw exact" then named that camera, which
// made another picture: the coarse frame came again.
TEST_F(RefineTest, TheFirstPictureGoesOnWithTheCameraThatItsCoarseFrameTold) {
  Start();
  Viewer viewer(cluster_->address());
  ASSERT_NO_FATAL_FAILURE(MakeSlow(&viewer, FrameOf(0)));
  v1::RenderIsosurfaceRequest request = FrameOf(0);
  request.clear_camera();
  request.set_camera_fit(v1::CAMERA_FIT_CELLS);
  v1::Refinement limited = All();
  limited.set_max_exact_bytes(1);
  const Answers deferred = viewer.ReadAll(viewer.Send(request, limited));
  ASSERT_TRUE(deferred.last.has_value());
  ASSERT_TRUE(deferred.last->has_exact_deferred());
  ASSERT_EQ(deferred.coarse.size(), 1U);

  v1::RenderIsosurfaceRequest named = request;
  named.clear_camera_fit();
  *named.mutable_camera() = deferred.coarse[0].frame().camera();
  const std::int64_t sequence = viewer.Send(named, All());
  const Answers exact = viewer.ReadAll(sequence);
  ASSERT_TRUE(exact.last.has_value());
  ASSERT_TRUE(exact.last->is_exact()) << exact.last->error().message();
  EXPECT_EQ(exact.last->sequence_number(), sequence);
  EXPECT_TRUE(exact.coarse.empty()) << "it is there";
  EXPECT_GT(exact.tiles.size(), 1U);
  for (const v1::InteractResponse& tile : exact.tiles) {
    ExpectRight(named, tile.tile());
  }
  EXPECT_TRUE(exact.last->frame().png() == Render(named));
  EXPECT_TRUE(exact.last->frame().png() == Render(request));
}

// A client that has lost its picture asks for it with the same limits.
TEST_F(RefineTest, WithTheSameLimitsTheToldCameraMakesAPictureOfItsOwn) {
  Start();
  Viewer viewer(cluster_->address());
  v1::RenderIsosurfaceRequest request = FrameOf(0);
  request.clear_camera();
  request.set_camera_fit(v1::CAMERA_FIT_CELLS);
  v1::Refinement limited = All();
  limited.set_max_exact_bytes(1);
  const Answers deferred = viewer.ReadAll(viewer.Send(request, limited));
  ASSERT_EQ(deferred.coarse.size(), 1U);
  request.clear_camera_fit();
  *request.mutable_camera() = deferred.coarse[0].frame().camera();
  EXPECT_EQ(viewer.ReadAll(viewer.Send(request, limited)).coarse.size(), 1U);
}

// The limit is lowered while the coarse frame is drawn. Should that be too late, nothing is deferred.
TEST_F(RefineTest, UnderALoweredLimitTheViewIsToldWhatItsLevelHides) {
  Start();
  Viewer viewer(cluster_->address());
  v1::RenderIsosurfaceRequest request = FrameOf(0);
  request.set_isovalue(117);  // of which nothing is known
  ASSERT_NO_FATAL_FAILURE(MakeSlow(&viewer, request));
  request.set_with_unresolved_count(true);
  const std::int64_t first = viewer.Send(request, All());
  absl::SleepFor(absl::Milliseconds(6));
  v1::Refinement limited = All();
  limited.set_max_exact_bytes(1);
  viewer.Send(request, limited);
  const Answers answers = viewer.ReadAll(first);
  ASSERT_TRUE(answers.last.has_value());
  ASSERT_FALSE(answers.last->has_error()) << answers.last->error().message();
  if (answers.last->has_exact_deferred()) {
    ASSERT_FALSE(answers.coarse.empty());
    const v1::RenderIsosurfaceResponse& shown = answers.coarse.back().frame();
    EXPECT_TRUE(shown.statistics().has_unresolved_block_count());
    EXPECT_EQ(shown.drawn_level().level(), answers.coarse[0].frame().drawn_level().level());
  }
}

TEST_F(RefineTest, TheCoarseFrameAtRestHasAHigherQualityThanMovingViews) {
  Start();
  Viewer viewer(cluster_->address());
  ASSERT_NO_FATAL_FAILURE(MakeSlow(&viewer, FrameOf(0)));
  // The network is fast, if all of the time went into decoding.
  viewer.Send(FrameOf(1), All(), /*is_at_rest=*/false);
  const std::optional<v1::InteractResponse> moving = viewer.ReadOnly();
  ASSERT_TRUE(moving.has_value());
  ASSERT_FALSE(moving->frame().jpeg().empty()) << moving->ShortDebugString();
  viewer.Acknowledge(*moving, absl::Hours(1));

  const Answers answers = viewer.ReadAll(viewer.Send(FrameOf(2), All()));
  ASSERT_EQ(answers.coarse.size(), 1U);
  const std::string tables = QuantisationOf(answers.coarse[0].frame().jpeg());
  ASSERT_FALSE(tables.empty());
  EXPECT_NE(QuantisationOf(kRestQuality), QuantisationOf(kMovingQuality));
  EXPECT_EQ(tables, QuantisationOf(kRestQuality));
}

// The coordinator works on one frame at a time. Frames have numbers in the order of their turns.
TEST_F(RefineTest, AnotherClientHasItsTurnBetweenTwoTiles) {
  Start({"--max-concurrent-frames", "1"});
  Viewer viewer(cluster_->address());
  ASSERT_NO_FATAL_FAILURE(MakeSlow(&viewer, FrameOf(0)));
  v1::RenderIsosurfaceRequest of_other = FrameOf(3);
  of_other.set_with_trace(true);
  const auto number_of_turn = [&]() -> std::int64_t {
    const auto response = testing::Render(cluster_->address(), of_other, kLimit);
    ISOSCOPE_EXPECT_OK(response.status());
    return response.ok() ? response->trace().frame_number() : 0;
  };
  const std::int64_t before = number_of_turn();

  // At most four answers are on their way, so most tiles wait for this client.
  v1::RenderIsosurfaceRequest large = FrameOf(1);
  large.mutable_viewport()->set_width_px(1600);
  large.mutable_viewport()->set_height_px(1600);
  viewer.Send(large, All());
  std::vector<v1::InteractResponse> unshown;
  do {
    std::optional<v1::InteractResponse> response = viewer.ReadOnly();
    ASSERT_TRUE(response.has_value());
    ASSERT_FALSE(response->is_exact() || response->has_error()) << response->error().message();
    unshown.push_back(*std::move(response));
  } while (!unshown.back().has_tile());
  const int tile_count = unshown.back().tile().count();
  ASSERT_GT(tile_count, 8);

  // One of the next tiles does not end until the other client waits.
  cluster_->agent(0).Stop();
  for (const v1::InteractResponse& response : unshown) {
    viewer.Acknowledge(response);
  }
  const auto cluster = v1::ClusterService::NewStub(rpc::MakeFreshChannel(cluster_->address()));
  const auto wait_for = [&](int working, int queued) {
    v1::GetClusterStatusResponse status;
    do {
      grpc::ClientContext context;
      ASSERT_TRUE(cluster->GetClusterStatus(&context, {}, &status).ok());
    } while (status.load().working_frame_count() != working ||
             status.load().queued_frame_count() != queued);
  };
  ASSERT_NO_FATAL_FAILURE(wait_for(1, 0));
  std::int64_t turn = 0;
  std::thread other([&] { turn = number_of_turn(); });
  absl::Cleanup joins = [&] { other.join(); };
  wait_for(1, 1);
  cluster_->agent(0).Signal(SIGCONT);
  std::optional<v1::InteractResponse> response;
  do {
    response = viewer.Read();
    ASSERT_TRUE(response.has_value());
    ASSERT_FALSE(response->has_error()) << response->error().message();
  } while (!response->is_exact());
  std::move(joins).Invoke();

  // Plan, coarse frame and tiles of the view with the other's frame among them, and the exact frame.
  const std::int64_t after = number_of_turn();
  EXPECT_EQ(after, before + 2 + tile_count + 1 + 1 + 1) << "nothing else was drawn";
  EXPECT_LT(turn, after - 2) << "before the last tile";
}

TEST_F(RefineTest, AnotherPictureEndsTheTilesAndTheSameOneGoesOn) {
  Start();
  Viewer viewer(cluster_->address());
  ASSERT_NO_FATAL_FAILURE(MakeSlow(&viewer, FrameOf(0)));
  // The same picture with another focus, after the first tile.
  const std::int64_t begun = viewer.Send(FrameOf(1), All());
  std::int64_t same = 0;
  std::vector<std::string> regions;
  const Answers answers = viewer.ReadAll(begun, [&](const v1::InteractResponse& response) {
    regions.push_back(response.tile().region().ShortDebugString());
    if (same == 0) {
      v1::Refinement refinement = All();
      refinement.mutable_focus()->set_x(0);
      same = viewer.Send(FrameOf(1), refinement);
    }
  });
  ASSERT_TRUE(answers.last.has_value());
  ASSERT_TRUE(answers.last->is_exact());
  EXPECT_THAT(answers.last->sequence_number(), AnyOf(begun, same)) << "the tiles were quick";
  EXPECT_EQ(static_cast<int>(regions.size()), answers.tiles.front().tile().count());
  std::sort(regions.begin(), regions.end());
  EXPECT_EQ(std::unique(regions.begin(), regions.end()), regions.end()) << "no tile comes twice";
  EXPECT_TRUE(answers.last->frame().png() == Render(FrameOf(1)));

  // Another picture, after the first tile.
  ASSERT_NO_FATAL_FAILURE(MakeSlow(&viewer, FrameOf(0)));
  viewer.Send(FrameOf(2), All());
  std::optional<v1::InteractResponse> response;
  do {
    response = viewer.Read();
    ASSERT_TRUE(response.has_value());
  } while (!response->has_tile());
  const Answers of_other = viewer.ReadAll(viewer.Send(FrameOf(3), All()));
  ASSERT_TRUE(of_other.last.has_value());
  ASSERT_TRUE(of_other.last->is_exact());
  for (const v1::InteractResponse& tile : of_other.tiles) {
    ExpectRight(FrameOf(3), tile.tile());
  }
  EXPECT_TRUE(of_other.last->frame().png() == Render(FrameOf(3)));
}

// At any moment of a refinement an agent may die.
TEST_F(RefineTest, AnAgentThatIsKilledGivesAnErrorOrTheRightPixels) {
  Start();
  std::string expected = Render(FrameOf(1));
  for (int round = 0; round < 4; ++round) {
    const int victim = round % kShardCount;
    Viewer viewer(cluster_->address());
    ASSERT_NO_FATAL_FAILURE(MakeSlow(&viewer, FrameOf(0)));
    int tile_count = 0;
    const Answers answers =
        viewer.ReadAll(viewer.Send(FrameOf(1), All()), [&](const v1::InteractResponse&) {
          if (++tile_count == 1 + round / kShardCount) {
            cluster_->agent(victim).Kill();
          }
        });
    ASSERT_TRUE(answers.last.has_value()) << "the stream goes on";
    ASSERT_FALSE(answers.tiles.empty());
    if (answers.last->has_error()) {
      EXPECT_THAT(answers.last->error().code(),
                  AnyOf(static_cast<int>(absl::StatusCode::kUnavailable),
                        static_cast<int>(absl::StatusCode::kFailedPrecondition)));
      EXPECT_THAT(answers.last->error().message(), HasSubstr(absl::StrCat("shard ", victim)));
    } else {
      EXPECT_TRUE(answers.last->frame().png() == expected);
    }
    ISOSCOPE_ASSERT_OK(cluster_->RestartAgent(victim));
    ASSERT_TRUE(Render(FrameOf(1)) == expected);  // the coordinator knows the agent again
    for (const v1::InteractResponse& tile : answers.tiles) {
      ExpectRight(FrameOf(1), tile.tile());
    }
    if (answers.last->has_error()) {
      const Answers again = viewer.ReadAll(viewer.Send(FrameOf(1), All()));
      ASSERT_TRUE(again.last.has_value());
      ASSERT_TRUE(again.last->is_exact()) << again.last->error().message();
      EXPECT_TRUE(again.last->frame().png() == expected);
    }
  }
}

TEST_F(RefineTest, LittleMemoryGivesTheSameBytesWithTilesOrWithout) {
  Start({"--memory-limit", "96MiB"});
  Viewer viewer(cluster_->address());
  v1::RenderIsosurfaceRequest request = FrameOf(5);
  ASSERT_NO_FATAL_FAILURE(MakeSlow(&viewer, request));
  for (const int width_px : {701, 1900}) {  // the second one has no room between tiles
    request.mutable_viewport()->set_width_px(width_px);
    request.mutable_viewport()->set_height_px(width_px);
    const Answers answers = viewer.ReadAll(viewer.Send(request, All()));
    ASSERT_TRUE(answers.last.has_value());
    ASSERT_TRUE(answers.last->is_exact()) << answers.last->error().message();
    EXPECT_EQ(answers.tiles.empty(), width_px == 1900);
    EXPECT_TRUE(answers.last->frame().png() == Render(request));
  }
}

TEST_F(RefineTest, ClientsThatDoNotAskGetOneExactFrameAsBefore) {
  Start();
  Viewer viewer(cluster_->address());
  ASSERT_NO_FATAL_FAILURE(MakeSlow(&viewer, FrameOf(0)));
  const Answers answers = viewer.ReadAll(viewer.Send(FrameOf(1), std::nullopt));
  ASSERT_TRUE(answers.last.has_value());
  ASSERT_TRUE(answers.last->is_exact());
  EXPECT_TRUE(answers.tiles.empty());
  EXPECT_TRUE(answers.coarse.empty());
  EXPECT_FALSE(answers.last->frame().has_drawn_level());
  EXPECT_EQ(answers.last->frame().statistics().band_count(), 1);
  EXPECT_TRUE(answers.last->frame().png() == Render(FrameOf(1)));
}

TEST_F(RefineTest, AWrongRefinementEndsTheStreamAndSaysWhy) {
  Start();
  const auto stub = v1::InteractService::NewStub(rpc::MakeFreshChannel(cluster_->address()));
  grpc::ClientContext context;
  context.set_deadline(base::MonotonicNow() + kLimit);
  const auto stream = stub->Interact(&context);
  v1::InteractRequest request;
  request.mutable_view_state()->set_sequence_number(1);
  *request.mutable_view_state()->mutable_frame() = FrameOf(0);
  request.mutable_view_state()->mutable_refinement()->mutable_focus()->set_x(2);
  stream->Write(request);
  v1::InteractResponse response;
  while (stream->Read(&response)) {
  }
  EXPECT_THAT(rpc::ToAbslStatus(stream->Finish()),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       HasSubstr("view_state.refinement.focus.x is 2: must lie in [0, 1]")));
}

}  // namespace
}  // namespace isoscope
