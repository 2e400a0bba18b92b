// Lights and colour maps through real processes: the pictures do not depend on agents, culling,
// stream or region, the response says how surfaces were coloured, and the command line's pictures
// can be made again.

#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/image/png_codec.h"
#include "core/io/file.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "tests/support/process.h"
#include "tests/support/process_cluster.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "wire/response_splitter.h"

namespace isoscope {
namespace {

namespace v1 = isoscope::v1;
using ::testing::HasSubstr;
using testing::ProcessCluster;

constexpr int kShardCounts[] = {1, 3};
constexpr int kSide = 120;

class LightTest : public ::testing::Test {
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
  static std::string Dataset(int shard_count) {
    return shared_->Sub(absl::StrCat("d", shard_count));
  }

  void StartCluster(int shard_count, const std::vector<std::string>& flags = {}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(cluster_,
                                  ProcessCluster::Start(Dataset(shard_count), shard_count, flags));
  }

  // Two lights on two surfaces, of which the second is coloured by its height.
  static v1::RenderIsosurfaceRequest Request() {
    v1::RenderIsosurfaceRequest request = testing::SmallRequest();
    request.clear_isovalue();
    request.mutable_viewport()->set_width_px(kSide);
    request.mutable_viewport()->set_height_px(kSide);
    request.add_surfaces()->set_isovalue(170);
    v1::Surface* const by_height = request.add_surfaces();
    by_height->set_isovalue(110);
    by_height->mutable_color_by()->set_quantity(v1::ColorBy::QUANTITY_POSITION_Y);
    by_height->mutable_color_by()->set_color_map(v1::COLOR_MAP_TURBO);
    v1::Light* const key = request.add_lights();
    key->mutable_direction()->set_x(-1);
    key->mutable_direction()->set_z(1);
    v1::Light* const rim = request.add_lights();
    rim->mutable_direction()->set_y(1);
    rim->set_space(v1::Light::SPACE_WORLD);
    rim->set_intensity(0.5F);
    return request;
  }

  absl::StatusOr<v1::RenderIsosurfaceResponse> Render(const v1::RenderIsosurfaceRequest& request) {
    return testing::Render(cluster_->address(), request, testing::kPatience);
  }

  static image::RgbaImage Decode(const v1::RenderIsosurfaceResponse& response) {
    absl::StatusOr<image::RgbaImage> image = image::DecodePng(response.png());
    EXPECT_THAT(image, testing::IsOk());
    return *std::move(image);
  }

  static testing::TempDir* shared_;
  std::unique_ptr<ProcessCluster> cluster_;
};

testing::TempDir* LightTest::shared_ = nullptr;

TEST_F(LightTest, PicturesDoNotDependOnAgentsCullingOrRegion) {
  std::string expected;
  for (const int shard_count : kShardCounts) {
    SCOPED_TRACE(shard_count);
    ASSERT_NO_FATAL_FAILURE(StartCluster(shard_count));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response, Render(Request()));
    if (expected.empty()) {
      expected = response.png();
    }
    EXPECT_TRUE(response.png() == expected);
    v1::RenderIsosurfaceRequest all = Request();
    all.set_culling(v1::CULLING_NONE);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse unculled, Render(all));
    EXPECT_TRUE(unculled.png() == expected);
    v1::RenderIsosurfaceRequest region = Request();
    region.mutable_region()->set_x(30);
    region.mutable_region()->set_y(50);
    region.mutable_region()->set_width_px(70);
    region.mutable_region()->set_height_px(40);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse part, Render(region));
    const image::RgbaImage whole_image = Decode(response);
    const image::RgbaImage part_image = Decode(part);
    for (std::size_t y = 0; y < 40; ++y) {
      for (std::size_t x = 0; x < 70; ++x) {
        ASSERT_EQ(part_image.pixels[y * 70 + x], whole_image.pixels[(y + 50) * kSide + x + 30]);
      }
    }
  }
}

TEST_F(LightTest, LightsAndColorsShowAndTheHeadLightIsStillTheDefault) {
  ASSERT_NO_FATAL_FAILURE(StartCluster(1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse lit, Render(Request()));
  v1::RenderIsosurfaceRequest request = Request();
  request.clear_lights();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse colored, Render(request));
  request.mutable_surfaces(1)->clear_color_by();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse plain, Render(request));
  EXPECT_TRUE(lit.png() != colored.png());
  EXPECT_TRUE(colored.png() != plain.png());
  EXPECT_EQ(plain.colorings_size(), 0);
  // Where the plain surface shows, colouring the other one changes one level at most: the head
  // light is computed from normals in place of steps.
  request = Request();
  request.clear_lights();
  request.mutable_output()->set_surface_index(true);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse planes, Render(request));
  const image::RgbaImage before = Decode(plain);
  const image::RgbaImage after = Decode(colored);
  std::size_t compared_count = 0;
  for (std::size_t i = 0; i < before.pixels.size(); ++i) {
    if (planes.surface_index()[i] == 0) {
      ++compared_count;
      ASSERT_NEAR(before.pixels[i].r, after.pixels[i].r, 1) << i;
    }
  }
  EXPECT_GT(compared_count, 1000U);
}

TEST_F(LightTest, TheResponseSaysHowSurfacesWereColored) {
  ASSERT_NO_FATAL_FAILURE(StartCluster(1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(v1::RenderIsosurfaceResponse response, Render(Request()));
  ASSERT_EQ(response.colorings_size(), 1);
  EXPECT_EQ(response.colorings(0).surface_index(), 1);
  EXPECT_EQ(response.colorings(0).color_by().color_map(), v1::COLOR_MAP_TURBO);
  EXPECT_EQ(response.colorings(0).color_by().range().min(), 0);
  EXPECT_EQ(response.colorings(0).color_by().range().max(), 36);
  v1::RenderIsosurfaceRequest request = Request();
  *request.mutable_surfaces(1)->mutable_color_by() = response.colorings(0).color_by();
  const std::string expected = response.png();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(response, Render(request));
  EXPECT_TRUE(response.png() == expected) << "the range that was used is that of the default";
}

TEST_F(LightTest, WrongLightsAndColorsAreNamedByTheServer) {
  ASSERT_NO_FATAL_FAILURE(StartCluster(1));
  const auto expect = [&](const v1::RenderIsosurfaceRequest& request, const char* what) {
    EXPECT_THAT(Render(request),
                testing::StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(what)));
  };
  v1::RenderIsosurfaceRequest request = Request();
  request.mutable_lights(1)->set_intensity(11);
  expect(request, "lights[1].intensity is 11: must lie in [0, 10]");
  request = Request();
  request.mutable_lights(0)->clear_direction();
  expect(request, "lights[0].direction is (0, 0, 0)");
  request = Request();
  request.mutable_surfaces(1)->mutable_color_by()->set_quantity(v1::ColorBy::QUANTITY_UNSPECIFIED);
  expect(request, "surfaces[1].color_by.quantity is 0");
  request = Request();
  request.mutable_surfaces(1)->mutable_color_by()->mutable_range()->set_min(3);
  expect(request, "surfaces[1].color_by.range.max is 0: must be greater");
  request = Request();
  v1::Light* const light = request.mutable_lights(0);
  light->GetReflection()->MutableUnknownFields(light)->AddVarint(90, 1);
  expect(request, "number 90");
}

TEST_F(LightTest, APictureAndItsNormalsComeOfOneDrawing) {
  ASSERT_NO_FATAL_FAILURE(StartCluster(3));
  v1::RenderIsosurfaceRequest request = Request();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse picture, Render(request));
  request.mutable_output()->set_normal(true);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse both, Render(request));
  EXPECT_TRUE(both.png() == picture.png());
  request.mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_NONE);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse normals, Render(request));
  EXPECT_TRUE(both.normal() == normals.normal());
}

TEST_F(LightTest, TheCommandLineDrawsLightsAndMapsAndMakesThePictureAgain) {
  const testing::TempDir folder;
  const auto run = [&](const std::vector<std::string>& flags) {
    std::vector<std::string> arguments{"render", Dataset(3)};
    arguments.insert(arguments.end(), flags.begin(), flags.end());
    return testing::RunIsoscope(arguments);
  };
  const std::string first = folder.Sub("first.png");
  const testing::CommandResult drawn =
      run({"--isovalue", "128", "--renderer", "cpu", "--width", "80", "--height", "60", "--light",
           "1,1,2:0.8", "--light", "-1,0,0:0.4:1,0.5,0", "--light-space", "world", "--color-by",
           "z:magma:5,20", "--output", first});
  ASSERT_EQ(drawn.exit_code, 0) << drawn.err;
  const testing::CommandResult again =
      run({"--like", first, "--renderer", "cpu", "--output", folder.Sub("again.png")});
  ASSERT_EQ(again.exit_code, 0) << again.err;
  EXPECT_THAT(again.out, HasSubstr("byte for byte"));
  EXPECT_EQ(run({"--like", first, "--light", "0,0,1", "--output", first}).exit_code, 2);
  const testing::CommandResult wrong =
      run({"--isovalue", "128", "--color-by", "x:jet", "--output", first});
  EXPECT_EQ(wrong.exit_code, 2);
  EXPECT_THAT(wrong.err, HasSubstr("viridis"));
}

// Both back ends draw normals, so lights look alike on both, and planes come of both.
TEST_F(LightTest, OpenGlDrawsNormalsToo) {
  const testing::TempDir folder;
  std::vector<image::RgbaImage> images;
  for (const std::string renderer : {"cpu", "egl"}) {
    const std::string png = folder.Sub(renderer + ".png");
    const std::string npy = folder.Sub(renderer + ".npy");
    const testing::CommandResult drawn =
        testing::RunIsoscope({"render",     Dataset(3), "--renderer", renderer,   "--isovalue",
                              "128",        "--width",  "90",         "--height", "70",
                              "--light",    "1,1,1",    "--color-by", "normal",   "--clip-plane",
                              "0,0,-1,-20", "--output", png,          "--normal", npy});
    ASSERT_EQ(drawn.exit_code, 0) << drawn.err;
    EXPECT_EQ(std::filesystem::file_size(npy), 128U + 90 * 70 * 12);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, io::ReadWholeFile(png, 1 << 20));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(images.emplace_back(), image::DecodePng(bytes));
  }
  std::size_t different_count = 0;
  for (std::size_t i = 0; i < images[0].pixels.size(); ++i) {
    different_count += std::abs(images[0].pixels[i].r - images[1].pixels[i].r) > 8 ? 1U : 0U;
  }
  EXPECT_LT(different_count, images[0].pixels.size() / 50);
}

}  // namespace
}  // namespace isoscope
