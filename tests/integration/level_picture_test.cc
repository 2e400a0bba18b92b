// Pictures, meshes and picks of levels, in clusters of real processes:
//
// - the same bytes for any cut, with and without culling, as a whole and as a region;
// - an 8-bit level is that of the same samples times 256, of 16 bits, to the last pixel;
// - the choice by the distance of samples, and what the answer tells;
// - camera, clip planes and omitted ranges are those of level 0;
// - what a level hides: bounds of depth, and unresolved blocks;
// - levels that are not there, in the dataset or in one shard, and rules that do not fit.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <grpcpp/client_context.h>

#include "core/base/coding.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "isoscope/v1/dataset_service.grpc.pb.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"
#include "tests/support/level_files.h"
#include "tests/support/process.h"
#include "tests/support/process_cluster.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope {
namespace {

namespace v1 = isoscope::v1;
using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::ProcessCluster;
using testing::StatusIs;
using testing::TestVolume;
using volume::LevelFilter;

constexpr math::Index3 kDims{67, 59, 53};
constexpr int kHighest = 2;

TestVolume Volume() {
  TestVolume volume = testing::GyroidVolume(kDims);
  volume.geometry.spacing = {1, 1.25, 0.75};
  volume.geometry.origin = {-3, 7, 0.5};
  return volume;
}

// The same samples times 256, of 16 bits.
TestVolume WideVolume() {
  TestVolume volume = Volume();
  std::string wide;
  for (const char sample : volume.samples) {
    base::AppendLittleEndian(static_cast<std::uint16_t>(static_cast<unsigned char>(sample) * 256),
                             &wide);
  }
  volume.type = volume::ScalarType::kUint16;
  volume.samples = std::move(wide);
  return volume;
}

absl::Status MakeLeveled(const TestVolume& volume, const std::string& directory, int shard_count,
                         LevelFilter filter = LevelFilter::kMean) {
  ISOSCOPE_RETURN_IF_ERROR(testing::MakeDataset(volume, directory, shard_count, 8));
  return testing::AddLevelFiles(directory, volume.samples, kHighest, filter).status();
}

class LevelPictureTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    shared_ = new testing::TempDir();
    ISOSCOPE_ASSERT_OK(MakeLeveled(Volume(), Path("one"), 1));
    ISOSCOPE_ASSERT_OK(MakeLeveled(Volume(), Path("three"), 3));
    ISOSCOPE_ASSERT_OK(MakeLeveled(WideVolume(), Path("wide"), 2));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(one_, ProcessCluster::Start(Path("one"), 1));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(three_, ProcessCluster::Start(Path("three"), 3));
  }
  static void TearDownTestSuite() {
    one_.reset();
    three_.reset();
    delete shared_;
    shared_ = nullptr;
  }
  static std::string Path(const std::string& name) { return shared_->Sub(name); }

  // The gyroid from beside.
  static v1::RenderIsosurfaceRequest Request(int level) {
    v1::RenderIsosurfaceRequest request = testing::SmallRequest();
    request.mutable_viewport()->set_width_px(200);
    request.mutable_viewport()->set_height_px(160);
    v1::Camera* const camera = request.mutable_camera();
    camera->mutable_eye()->set_x(150);
    camera->mutable_eye()->set_y(90);
    camera->mutable_eye()->set_z(110);
    camera->mutable_target()->set_x(30);
    camera->mutable_target()->set_y(43);
    camera->mutable_target()->set_z(20);
    camera->mutable_up()->set_y(1);
    camera->mutable_perspective()->set_fov_y_degrees(26);
    if (level >= 0) {
      request.mutable_level()->set_level(level);
    }
    return request;
  }

  // Samples, layers, effects, cuts with samples, colours by gradient and position, a parallel camera.
  static std::vector<std::pair<std::string, v1::RenderIsosurfaceRequest>> Requests(int level) {
    std::vector<std::pair<std::string, v1::RenderIsosurfaceRequest>> requests;
    requests.emplace_back("plain", Request(level));
    v1::RenderIsosurfaceRequest layers = Request(level);
    layers.clear_isovalue();
    for (const double isovalue : {128.0, 100.3, 150.0}) {
      v1::Surface* const surface = layers.add_surfaces();
      surface->set_isovalue(isovalue);
      surface->mutable_color()->set_red(0.9F);
      surface->mutable_color()->set_alpha(isovalue == 128 ? 1.0F : 0.4F);
    }
    layers.set_samples(4);
    layers.mutable_ambient_occlusion();
    layers.mutable_silhouette();
    requests.emplace_back("layers", layers);
    v1::RenderIsosurfaceRequest cut = Request(level);
    cut.clear_isovalue();
    v1::Surface* const gradient = cut.add_surfaces();
    gradient->set_isovalue(128);
    gradient->mutable_color_by()->set_quantity(v1::ColorBy::QUANTITY_GRADIENT_MAGNITUDE);
    gradient->mutable_color_by()->mutable_range()->set_max(40);
    v1::Surface* const position = cut.add_surfaces();
    position->set_isovalue(100);
    position->mutable_color_by()->set_quantity(v1::ColorBy::QUANTITY_POSITION_Y);
    cut.mutable_clip()->add_half_spaces()->mutable_normal()->set_x(-1);
    cut.mutable_clip()->mutable_half_spaces(0)->set_offset(-41);
    cut.mutable_caps()->set_color_map(v1::COLOR_MAP_TURBO);
    requests.emplace_back("cut", cut);
    v1::RenderIsosurfaceRequest parallel = Request(level);
    parallel.mutable_camera()->mutable_orthographic()->set_height(70);
    requests.emplace_back("parallel", parallel);
    return requests;
  }

  static absl::StatusOr<v1::RenderIsosurfaceResponse> Render(
      const ProcessCluster& cluster, const v1::RenderIsosurfaceRequest& request) {
    return testing::Render(cluster.address(), request);
  }

  static inline testing::TempDir* shared_ = nullptr;
  static inline std::unique_ptr<ProcessCluster> one_;
  static inline std::unique_ptr<ProcessCluster> three_;
};

TEST_F(LevelPictureTest, ALevelHasTheSameBytesForAnyCutAndCulling) {
  for (int level = 0; level <= kHighest; ++level) {
    for (auto [name, request] : Requests(level)) {
      SCOPED_TRACE(absl::StrCat("level ", level, ", ", name));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto one, Render(*one_, request));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto three, Render(*three_, request));
      EXPECT_EQ(one.png(), three.png());
      request.set_culling(v1::CULLING_NONE);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto unculled, Render(*three_, request));
      EXPECT_EQ(one.png(), unculled.png());
      EXPECT_EQ(one.drawn_level().level(), level);
      EXPECT_EQ(one.statistics().level(), level);
      EXPECT_GT(one.statistics().triangle_count(), 0);
    }
  }
}

TEST_F(LevelPictureTest, LevelsAreOtherPicturesAndOfFewerTriangles) {
  std::vector<std::string> pictures;
  std::int64_t triangles = INT64_MAX;
  for (int level = 0; level <= kHighest; ++level) {
    v1::RenderIsosurfaceRequest request = Request(level);
    request.set_culling(v1::CULLING_NONE);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto response, Render(*three_, request));
    EXPECT_LT(response.statistics().triangle_count(), triangles / 2);
    triangles = response.statistics().triangle_count();
    pictures.push_back(response.png());
    const double step = std::ldexp(1.0, level);
    EXPECT_EQ(response.drawn_level().spacing().x(), step);
    EXPECT_EQ(response.drawn_level().spacing().y(), 1.25 * step);
    EXPECT_EQ(response.drawn_level().spacing().z(), 0.75 * step);
  }
  EXPECT_NE(pictures[0], pictures[1]);
  EXPECT_NE(pictures[1], pictures[2]);
}

// A sample of a level of 8-bit data is stored times 256, so scaled isovalues are exact.
TEST_F(LevelPictureTest, AnEightBitLevelIsThatOfTheSamplesTimes256) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto wide, ProcessCluster::Start(Path("wide"), 2));
  for (int level = 1; level <= kHighest; ++level) {
    for (const auto& [name, request] : Requests(level)) {
      SCOPED_TRACE(absl::StrCat("level ", level, ", ", name));
      v1::RenderIsosurfaceRequest times_256 = request;
      times_256.set_isovalue(256 * request.isovalue());
      for (v1::Surface& surface : *times_256.mutable_surfaces()) {
        surface.set_isovalue(256 * surface.isovalue());
        if (surface.color_by().has_range()) {
          v1::ColorRange* const range = surface.mutable_color_by()->mutable_range();
          range->set_max(256 * range->max());
        }
      }
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto narrow, Render(*three_, request));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto scaled, Render(*wide, times_256));
      EXPECT_EQ(narrow.png(), scaled.png());
    }
  }
}

TEST_F(LevelPictureTest, WithoutAChoiceNothingIsNew) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto plain, Render(*three_, Request(-1)));
  EXPECT_FALSE(plain.has_drawn_level());
  EXPECT_EQ(plain.statistics().level(), 0);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto named, Render(*three_, Request(0)));
  EXPECT_EQ(named.png(), plain.png());
  EXPECT_TRUE(named.has_drawn_level());
}

TEST_F(LevelPictureTest, ARegionOfALevelHasThePixelsOfTheWhole) {
  v1::RenderIsosurfaceRequest request = Request(1);
  request.mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_RGBA8);
  request.mutable_silhouette();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto whole, Render(*three_, request));
  v1::Region* const region = request.mutable_region();
  region->set_x(71);
  region->set_y(33);
  region->set_width_px(90);
  region->set_height_px(70);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto part, Render(*three_, request));
  for (int y = 0; y < 70; ++y) {
    const std::size_t from = 4 * ((static_cast<std::size_t>(y) + 33) * 200 + 71);
    ASSERT_EQ(part.rgba8().substr(static_cast<std::size_t>(y) * 4 * 90, 4 * 90),
              whole.rgba8().substr(from, 4 * 90))
        << "row " << y;
  }
}

TEST_F(LevelPictureTest, ASpacingChoosesTheCoarsestLevelThatIsFineEnough) {
  v1::RenderIsosurfaceRequest request = Request(0);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto exact, Render(*three_, request));
  const double px = exact.drawn_level().max_spacing_px();
  ASSERT_GT(px, 0);
  const auto expect = [&](double max_spacing_px, int level) {
    request.mutable_level()->set_max_spacing_px(max_spacing_px);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto response, Render(*three_, request));
    EXPECT_EQ(response.drawn_level().level(), level) << max_spacing_px << " of " << px;
    EXPECT_DOUBLE_EQ(response.drawn_level().max_spacing_px(),
                     px * std::ldexp(1.0, static_cast<int>(level)));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto named,
                                  Render(*three_, Request(static_cast<int>(level))));
    EXPECT_EQ(response.png(), named.png());
  };
  expect(0.5 * px, 0);
  expect(1.9 * px, 0);
  expect(2.1 * px, 1);
  expect(3.9 * px, 1);
  expect(4.1 * px, 2);
  expect(1e9, 2);
}

// The choice is made for the whole viewport: a region, and samples, have no part in it.
TEST_F(LevelPictureTest, RegionsAndSamplesDoNotChoose) {
  v1::RenderIsosurfaceRequest request = Request(0);
  request.mutable_level()->set_max_spacing_px(3);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto whole, Render(*three_, request));
  request.set_samples(16);
  request.mutable_region()->set_width_px(5);
  request.mutable_region()->set_height_px(5);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto region, Render(*three_, request));
  EXPECT_EQ(whole.drawn_level().SerializeAsString(), region.drawn_level().SerializeAsString());
}

// The clip planes are level 0's, and the positions those of the world.
TEST_F(LevelPictureTest, DepthsOfALevelAreNearThoseOfLevelZero) {
  const auto depths_of = [](int level) {
    v1::RenderIsosurfaceRequest request = Request(level);
    request.mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_NONE);
    request.mutable_output()->set_depth(true);
    const auto response = Render(*three_, request);
    std::vector<float> depths(200 * 160);
    EXPECT_TRUE(response.ok()) << response.status();
    EXPECT_EQ(response->depth().size(), depths.size() * sizeof(float));
    std::memcpy(depths.data(), response->depth().data(), response->depth().size());
    return depths;
  };
  const std::vector<float> exact = depths_of(0);
  const std::vector<float> coarse = depths_of(1);
  // Whether level 0 has the depth within a spacing of the level, along the view or beside it.
  constexpr int kSpacingPx = 4;
  const auto is_near = [&](int x, int y) {
    const float depth = coarse[static_cast<std::size_t>(y * 200 + x)];
    for (int j = std::max(y - kSpacingPx, 0); j <= std::min(y + kSpacingPx, 159); ++j) {
      for (int i = std::max(x - kSpacingPx, 0); i <= std::min(x + kSpacingPx, 199); ++i) {
        if (std::abs(exact[static_cast<std::size_t>(j * 200 + i)] - depth) < 2) {
          return true;
        }
      }
    }
    return false;
  };
  std::size_t both = 0;
  std::size_t near = 0;
  for (int y = 0; y < 160; ++y) {
    for (int x = 0; x < 200; ++x) {
      const auto i = static_cast<std::size_t>(y * 200 + x);
      if (std::isfinite(exact[i]) && std::isfinite(coarse[i])) {
        ++both;
        near += is_near(x, y) ? 1U : 0U;
      }
    }
  }
  EXPECT_GT(both, 3000U);
  EXPECT_GT(static_cast<double>(near), 0.98 * static_cast<double>(both));
}

// What a level hides is bounded by the blocks of level 0, whatever is drawn.
TEST_F(LevelPictureTest, BoundsOfDepthAreThoseOfLevelZeroAtEveryLevel) {
  v1::RenderIsosurfaceRequest exact = Request(0);
  exact.mutable_output()->set_depth(true);
  exact.mutable_output()->set_depth_bounds(true);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto expected, Render(*one_, exact));
  const std::string& bounds = expected.depth_bounds();
  ASSERT_EQ(bounds.size(), 2 * expected.depth().size());
  const auto float_at = [](const std::string& plane, std::size_t i) {
    return base::LoadLittleEndian<float>(plane.data() + 4 * i);
  };
  for (std::size_t i = 0; i < expected.depth().size() / 4; ++i) {
    const float depth = float_at(expected.depth(), i);
    if (!std::isinf(depth)) {
      ASSERT_LE(float_at(bounds, 2 * i), depth) << "pixel " << i;
      ASSERT_GE(float_at(bounds, 2 * i + 1), depth) << "pixel " << i;
    }
  }
  for (int level = 0; level <= kHighest; ++level) {
    v1::RenderIsosurfaceRequest request = Request(level);
    request.mutable_output()->set_depth_bounds(true);
    for (const ProcessCluster* cluster : {one_.get(), three_.get()}) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto response, Render(*cluster, request));
      EXPECT_TRUE(response.depth_bounds() == bounds) << "level " << level;
    }
  }
}

TEST_F(LevelPictureTest, UnresolvedBlocksAreTheSameForAnyShardsAndToldFromThenOn) {
  v1::RenderIsosurfaceRequest exact = Request(0);
  exact.set_with_unresolved_count(true);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto at_zero, Render(*one_, exact));
  EXPECT_FALSE(at_zero.statistics().has_unresolved_block_count());
  for (int level = 1; level <= kHighest; ++level) {
    v1::RenderIsosurfaceRequest request = Request(level);
    request.set_with_unresolved_count(true);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto one, Render(*one_, request));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto three, Render(*three_, request));
    ASSERT_TRUE(one.statistics().has_unresolved_block_count());
    EXPECT_EQ(one.statistics().unresolved_block_count(),
              three.statistics().unresolved_block_count());
    EXPECT_LT(one.statistics().unresolved_block_count(), at_zero.statistics().active_block_count());
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto later, Render(*one_, Request(level)));
    EXPECT_EQ(later.statistics().unresolved_block_count(),
              one.statistics().unresolved_block_count());
  }
}

// A vessel of one voxel is gone at level 1: every block that it meets is unresolved.
TEST_F(LevelPictureTest, ALoneVesselIsCountedAsUnresolved) {
  TestVolume vessel = Volume();
  std::fill(vessel.samples.begin(), vessel.samples.end(), '\0');
  for (std::int64_t x = 0; x < kDims.x; ++x) {
    vessel.samples[static_cast<std::size_t>(x + kDims.x * (20 + kDims.y * 20))] = '\xff';
  }
  ISOSCOPE_ASSERT_OK(MakeLeveled(vessel, Path("vessel"), 2));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster, ProcessCluster::Start(Path("vessel"), 2));
  v1::RenderIsosurfaceRequest request = Request(0);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto exact, Render(*cluster, request));
  EXPECT_EQ(exact.statistics().active_block_count(), 9) << "66 cells in blocks of 8";
  for (int level = 1; level <= kHighest; ++level) {
    request = Request(level);
    request.set_with_unresolved_count(true);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto response, Render(*cluster, request));
    EXPECT_EQ(response.statistics().unresolved_block_count(), 9);
  }
}

TEST_F(LevelPictureTest, OmittedRangesAreThoseOfLevelZero) {
  v1::RenderIsosurfaceRequest exact = Requests(0)[2].second;
  v1::RenderIsosurfaceRequest coarse = Requests(2)[2].second;
  exact.mutable_surfaces(0)->mutable_color_by()->clear_range();
  coarse.mutable_surfaces(0)->mutable_color_by()->clear_range();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto of_exact, Render(*three_, exact));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto of_coarse, Render(*three_, coarse));
  ASSERT_EQ(of_exact.colorings_size(), 2);
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(of_exact.colorings(i).color_by().range().SerializeAsString(),
              of_coarse.colorings(i).color_by().range().SerializeAsString());
  }
  EXPECT_EQ(of_exact.caps_coloring().caps().range().SerializeAsString(),
            of_coarse.caps_coloring().caps().range().SerializeAsString());
  EXPECT_GT(of_exact.caps_coloring().caps().range().max(), 0);
  EXPECT_LE(of_exact.caps_coloring().caps().range().max(), 255);
}

TEST_F(LevelPictureTest, TheDefaultCameraIsThatOfLevelZero) {
  v1::RenderIsosurfaceRequest request = Request(0);
  request.clear_camera();
  for (const v1::CameraFit fit :
       {v1::CAMERA_FIT_VOLUME, v1::CAMERA_FIT_SURFACE, v1::CAMERA_FIT_CELLS}) {
    request.set_camera_fit(fit);
    request.mutable_level()->set_level(0);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto exact, Render(*three_, request));
    request.mutable_level()->set_level(2);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto coarse, Render(*three_, request));
    EXPECT_EQ(exact.camera().SerializeAsString(), coarse.camera().SerializeAsString());
  }
}

TEST_F(LevelPictureTest, LevelsThatAreNotThereAreNamed) {
  EXPECT_THAT(Render(*three_, Request(3)),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       AllOf(HasSubstr("level is 3"), HasSubstr("levels 0, 1, 2"))));
  EXPECT_THAT(Render(*three_, Request(24)),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("level.level is 24")));
}

TEST_F(LevelPictureTest, LabelsDoNotFitMeans) {
  v1::RenderIsosurfaceRequest request = Request(1);
  request.clear_isovalue();
  request.add_surfaces()->add_labels(128);
  EXPECT_THAT(Render(*three_, request),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       AllOf(HasSubstr("surfaces[0]"), HasSubstr("means"))));
  request.mutable_level()->set_max_spacing_px(1000);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto chosen, Render(*three_, request));
  EXPECT_EQ(chosen.drawn_level().level(), 0);
}

TEST_F(LevelPictureTest, LabelsAreDrawnFromMajorities) {
  TestVolume volume = Volume();
  for (char& sample : volume.samples) {
    sample = static_cast<char>(static_cast<unsigned char>(sample) / 64);  // 0 to 3
  }
  ISOSCOPE_ASSERT_OK(MakeLeveled(volume, Path("labels"), 2, LevelFilter::kMajority));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster, ProcessCluster::Start(Path("labels"), 2));
  v1::RenderIsosurfaceRequest request = Request(1);
  EXPECT_THAT(Render(*cluster, request),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("isovalue")));
  request.clear_isovalue();
  request.add_surfaces()->add_labels(2);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto coarse, Render(*cluster, request));
  EXPECT_EQ(coarse.drawn_level().level(), 1);
  EXPECT_GT(coarse.statistics().triangle_count(), 0);
  request.set_culling(v1::CULLING_NONE);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto unculled, Render(*cluster, request));
  EXPECT_EQ(coarse.png(), unculled.png());
}

// A shard without a level says so, and serves the rest.
TEST_F(LevelPictureTest, ADatasetServesTheLevelsThatEveryShardHas) {
  ISOSCOPE_ASSERT_OK(MakeLeveled(Volume(), Path("gap"), 2));
  std::filesystem::remove_all(absl::StrCat(testing::ShardDirectory(Path("gap"), 1, 2), "/level_1"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster, ProcessCluster::Start(Path("gap"), 2));
  EXPECT_THAT(Render(*cluster, Request(1)),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("levels 0, 2")));
  for (const int level : {0, 2}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto response, Render(*cluster, Request(level)));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto expected, Render(*three_, Request(level)));
    EXPECT_EQ(response.png(), expected.png());
  }
}

TEST_F(LevelPictureTest, TheDatasetTellsItsLevels) {
  const auto stub = v1::DatasetService::NewStub(rpc::MakeFreshChannel(three_->address()));
  grpc::ClientContext context;
  v1::GetDatasetResponse response;
  ISOSCOPE_ASSERT_OK(
      rpc::ToAbslStatus(stub->GetDataset(&context, v1::GetDatasetRequest(), &response)));
  ASSERT_EQ(response.dataset().levels_size(), kHighest);
  const v1::DatasetLevel& level = response.dataset().levels(1);
  EXPECT_EQ(level.level(), 2);
  EXPECT_EQ(level.filter(), v1::DatasetLevel::FILTER_MEAN);
  EXPECT_EQ(level.geometry().sample_dims().x(), kDims.x / 4);
  EXPECT_EQ(level.geometry().spacing().y(), 5);
}

// Exports of a level are coarser meshes, the same for any cut; measures are of level 0.
TEST_F(LevelPictureTest, AnExportOfALevelIsACoarserMesh) {
  const auto bytes_of = [](const ProcessCluster& cluster, int level,
                           bool with_measures) -> absl::StatusOr<std::string> {
    v1::ExportIsosurfaceRequest request;
    request.set_isovalue(128);
    request.set_level(level);
    request.set_with_measures(with_measures);
    const auto stub = v1::IsosurfaceService::NewStub(rpc::MakeFreshChannel(cluster.address()));
    grpc::ClientContext context;
    context.set_deadline(base::MonotonicNow() + testing::kPatience);
    const auto reader = stub->ExportIsosurface(&context, request);
    std::string positions;
    std::string triangles;
    v1::ExportIsosurfaceResponse chunk;
    while (reader->Read(&chunk)) {
      positions += chunk.positions();
      triangles += chunk.triangles();
    }
    ISOSCOPE_RETURN_IF_ERROR(rpc::ToAbslStatus(reader->Finish()));
    return positions + triangles;
  };
  std::size_t size = SIZE_MAX;
  for (int level = 0; level <= kHighest; ++level) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string one, bytes_of(*one_, level, false));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string three, bytes_of(*three_, level, false));
    EXPECT_EQ(one, three) << "level " << level;
    EXPECT_LT(one.size(), size / 2);
    EXPECT_GT(one.size(), 1000U);
    size = one.size();
  }
  EXPECT_THAT(bytes_of(*three_, 1, true),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("measures are of level 0")));
  EXPECT_THAT(bytes_of(*three_, 3, false),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("levels 0, 1, 2")));
}

TEST_F(LevelPictureTest, PicksAreOfLevelZero) {
  const auto stub = v1::IsosurfaceService::NewStub(rpc::MakeFreshChannel(three_->address()));
  const auto pick = [&](int level) {
    v1::PickSurfaceRequest request;
    *request.mutable_frame() = Request(level);
    for (int i = 0; i < 20; ++i) {
      v1::Pixel* const pixel = request.add_pixels();
      pixel->set_x(60 + 4 * i);
      pixel->set_y(70);
    }
    grpc::ClientContext context;
    v1::PickSurfaceResponse response;
    const grpc::Status status = stub->PickSurface(&context, request, &response);
    EXPECT_TRUE(status.ok()) << status.error_message();
    std::string points;
    for (const v1::PickedPoint& point : response.points()) {
      points += point.SerializeAsString();
    }
    return points;
  };
  const std::string exact = pick(-1);
  EXPECT_GT(exact.size(), 100U);
  EXPECT_EQ(pick(2), exact);
}

}  // namespace
}  // namespace isoscope
