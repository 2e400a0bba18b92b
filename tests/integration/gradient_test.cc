// Surfaces that are coloured by the length of the gradient, through real processes: closed forms,
// the range of the dataset, agents and culling, planes and picks, and the command line.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/image/png_codec.h"
#include "core/io/file.h"
#include "core/picture/color_map.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "tests/support/process.h"
#include "tests/support/process_cluster.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope {
namespace {

namespace v1 = isoscope::v1;
using ::testing::HasSubstr;
using testing::ProcessCluster;

constexpr int kSide = 96;
constexpr math::Index3 kDims{33, 29, 31};

// A field of world space: unit spacing, the origin at the first sample.
testing::TestVolume VolumeOf(const std::function<double(double, double, double)>& field) {
  testing::TestVolume volume;
  volume.geometry.sample_dims = kDims;
  volume.type = volume::ScalarType::kFloat32;
  for (std::int64_t z = 0; z < kDims.z; ++z) {
    for (std::int64_t y = 0; y < kDims.y; ++y) {
      for (std::int64_t x = 0; x < kDims.x; ++x) {
        base::AppendLittleEndian(
            static_cast<float>(
                field(static_cast<double>(x), static_cast<double>(y), static_cast<double>(z))),
            &volume.samples);
      }
    }
  }
  return volume;
}

float FloatAt(const std::string& bytes, std::size_t index) {
  float value = 0;
  std::memcpy(&value, bytes.data() + index * sizeof(value), sizeof(value));
  return value;
}

class GradientTest : public ::testing::Test {
 protected:
  void Start(const testing::TestVolume& volume, int shard_count, int block_edge) {
    cluster_.reset();
    directory_ = folder_.Sub(absl::StrCat("d", ++dataset_count_));
    ISOSCOPE_ASSERT_OK(testing::MakeDataset(volume, directory_, shard_count, block_edge));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(cluster_, ProcessCluster::Start(directory_, shard_count));
  }

  // One surface whose pixels have the colours of the map, without light.
  static v1::RenderIsosurfaceRequest Request(double isovalue) {
    v1::RenderIsosurfaceRequest request = testing::SmallRequest();
    request.clear_isovalue();
    request.mutable_viewport()->set_width_px(kSide);
    request.mutable_viewport()->set_height_px(kSide);
    v1::Surface* const surface = request.add_surfaces();
    surface->set_isovalue(isovalue);
    surface->mutable_material()->set_ambient(1);
    surface->mutable_material()->set_diffuse(0);
    surface->mutable_material()->set_specular(0);
    surface->mutable_color_by()->set_quantity(v1::ColorBy::QUANTITY_GRADIENT_MAGNITUDE);
    surface->mutable_color_by()->set_color_map(v1::COLOR_MAP_GREY);
    request.mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_RGBA8);
    request.mutable_output()->set_position(true);
    request.mutable_output()->set_surface_index(true);
    return request;
  }

  absl::StatusOr<v1::RenderIsosurfaceResponse> Render(const v1::RenderIsosurfaceRequest& request) {
    return testing::Render(cluster_->address(), request, testing::kPatience);
  }

  // Expects each pixel's grey to be the step of the length that `magnitude` gives for its place,
  // within `tolerance` steps. Returns the number of pixels.
  static int CheckGreys(const v1::RenderIsosurfaceResponse& response,
                        const std::function<double(double, double, double)>& magnitude,
                        int tolerance) {
    const v1::ColorRange& range = response.colorings(0).color_by().range();
    int count = 0;
    for (std::size_t i = 0; i < response.surface_index().size(); ++i) {
      if (response.surface_index()[i] != 0) {
        continue;
      }
      ++count;
      const double value = magnitude(static_cast<double>(FloatAt(response.position(), 3 * i)),
                                     static_cast<double>(FloatAt(response.position(), 3 * i + 1)),
                                     static_cast<double>(FloatAt(response.position(), 3 * i + 2)));
      const int expected = static_cast<int>(
          picture::ColorMapStepOf(value, {.min = range.min(), .max = range.max()}));
      const int grey = static_cast<std::uint8_t>(response.rgba8()[4 * i]);
      EXPECT_NEAR(grey, expected, tolerance) << "pixel " << i << ", length " << value;
      if (HasFailure()) {
        break;
      }
    }
    return count;
  }

  testing::TempDir folder_;
  std::string directory_;
  int dataset_count_ = 0;
  std::unique_ptr<ProcessCluster> cluster_;
};

// The gradient is (x, 3, 0), also by central differences.
TEST_F(GradientTest, TheRangeOfWhatIsVisibleHoldsTheLengthsOfThePicture) {
  const testing::TestVolume volume =
      VolumeOf([](double x, double y, double) { return 0.5 * x * x + 3 * y; });
  v1::RenderIsosurfaceRequest request = Request(150);
  v1::ColorRange* const range = request.mutable_surfaces(0)->mutable_color_by()->mutable_range();
  range->set_source(v1::ColorRange::SOURCE_VISIBLE);
  std::string pixels;
  v1::ColorRange found;
  for (const int shard_count : {1, 3}) {
    ASSERT_NO_FATAL_FAILURE(Start(volume, shard_count, shard_count == 1 ? 8 : 16));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response, Render(request));
    found = response.colorings(0).color_by().range();
    EXPECT_TRUE(pixels.empty() || pixels == response.rgba8()) << shard_count << " shards";
    pixels = response.rgba8();
    double least = 1e9;
    double greatest = 0;
    for (std::size_t i = 0; i < response.surface_index().size(); ++i) {
      if (response.surface_index()[i] == 0) {
        const double length =
            std::hypot(static_cast<double>(FloatAt(response.position(), 3 * i)), 3);
        least = std::min(least, length);
        greatest = std::max(greatest, length);
      }
    }
    ASSERT_LT(least + 1, greatest);
    // Lengths on a triangle are those of its vertices, mixed.
    const double slack = 0.1 + 0.02 * (greatest - least);
    EXPECT_NEAR(found.min(), least, slack);
    EXPECT_NEAR(found.max(), greatest, slack);
  }
  *range = found;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse again, Render(request));
  EXPECT_EQ(again.rgba8(), pixels);
  request.mutable_surfaces(0)->mutable_color_by()->clear_range();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse whole, Render(request));
  EXPECT_NE(whole.rgba8(), pixels);
}

TEST_F(GradientTest, ALinearFieldHasOneColorAndTheLastOneByDefault) {
  ASSERT_NO_FATAL_FAILURE(
      Start(VolumeOf([](double x, double y, double z) { return 2 * x - 3 * y + 6 * z; }), 2, 8));
  const auto seven = [](double, double, double) { return 7.0; };
  v1::RenderIsosurfaceRequest request = Request(80);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(v1::RenderIsosurfaceResponse response, Render(request));
  ASSERT_EQ(response.colorings_size(), 1);
  EXPECT_EQ(response.colorings(0).color_by().range().min(), 0);
  EXPECT_NEAR(response.colorings(0).color_by().range().max(), 7, 1e-12);
  EXPECT_GT(CheckGreys(response, seven, 0), 1000);
  v1::ColorRange* const range = request.mutable_surfaces(0)->mutable_color_by()->mutable_range();
  range->set_min(2);
  range->set_max(18.1);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(response, Render(request));
  EXPECT_GT(CheckGreys(response, seven, 0), 1000);
}

TEST_F(GradientTest, AQuadraticFieldHasTheLengthsOfTheClosedForm) {
  // Central differences of x z are exact; one-sided ones at the border too.
  ASSERT_NO_FATAL_FAILURE(Start(
      VolumeOf([](double x, double y, double z) { return (x - 10) * (z + 3) + 0 * y; }), 3, 5));
  const v1::RenderIsosurfaceRequest request = Request(90.5);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response, Render(request));
  EXPECT_NEAR(response.colorings(0).color_by().range().max(), std::hypot(22, 33), 1e-9);
  EXPECT_GT(CheckGreys(
                response, [](double x, double, double z) { return std::hypot(x - 10, z + 3); }, 1),
            1000);
}

TEST_F(GradientTest, CapsShowTheLengthOnTheCut) {
  ASSERT_NO_FATAL_FAILURE(Start(
      VolumeOf([](double x, double y, double z) { return (x - 10) * (z + 3) + 0 * y; }), 3, 5));
  v1::RenderIsosurfaceRequest request = Request(90.5);
  v1::HalfSpace* const half_space = request.mutable_clip()->add_half_spaces();
  half_space->mutable_normal()->set_z(-1);
  half_space->set_offset(-12.25);
  request.mutable_caps();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response, Render(request));
  EXPECT_GT(CheckGreys(
                response, [](double x, double, double z) { return std::hypot(x - 10, z + 3); }, 1),
            1000);
  int cap_count = 0;
  for (std::size_t i = 0; i < response.surface_index().size(); ++i) {
    cap_count += response.surface_index()[i] == 0 &&
                         std::abs(FloatAt(response.position(), 3 * i + 2) - 12.25F) < 1e-3F
                     ? 1
                     : 0;
  }
  EXPECT_GT(cap_count, 500);
}

TEST_F(GradientTest, AgentsBlocksCullingAndRepetitionDoNotShow) {
  const testing::TestVolume volume = testing::GyroidVolume({43, 37, 29});
  v1::RenderIsosurfaceRequest request = Request(110);
  request.mutable_surfaces(0)->clear_material();
  v1::Surface* const glass = request.add_surfaces();
  glass->set_isovalue(150);
  *glass->mutable_color_by() = request.surfaces(0).color_by();
  glass->mutable_color_by()->mutable_opacity()->set_at_max(0.9F);
  request.mutable_lights()->Add()->mutable_direction()->set_x(1);
  v1::HalfSpace* const half_space = request.mutable_clip()->add_half_spaces();
  half_space->mutable_normal()->set_z(-1);
  half_space->set_offset(-20.3);
  request.mutable_caps();
  std::string expected;
  for (const auto& [shard_count, edge] : {std::pair(1, 8), std::pair(3, 8), std::pair(2, 5)}) {
    ASSERT_NO_FATAL_FAILURE(Start(volume, shard_count, edge));
    for (const v1::Culling culling : {v1::CULLING_DEPTH, v1::CULLING_NONE, v1::CULLING_DEPTH}) {
      request.set_culling(culling);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response, Render(request));
      if (expected.empty()) {
        expected = response.rgba8();
      }
      EXPECT_TRUE(response.rgba8() == expected) << shard_count << ", " << edge;
    }
  }
}

TEST_F(GradientTest, PlanesAreThoseOfAPlainFrame) {
  ASSERT_NO_FATAL_FAILURE(Start(testing::GyroidVolume({43, 37, 29}), 2, 8));
  v1::RenderIsosurfaceRequest request = Request(128);
  request.mutable_output()->set_normal(true);
  request.mutable_output()->set_depth(true);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse colored, Render(request));
  request.mutable_surfaces(0)->clear_color_by();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse plain, Render(request));
  EXPECT_TRUE(colored.depth() == plain.depth());
  EXPECT_TRUE(colored.normal() == plain.normal());
  EXPECT_TRUE(colored.position() == plain.position());
  EXPECT_TRUE(colored.rgba8() != plain.rgba8());
}

TEST_F(GradientTest, TheCommandLineDrawsItOnBothBackEndsAndMakesItAgain) {
  ISOSCOPE_ASSERT_OK(
      testing::MakeDataset(testing::GyroidVolume({43, 37, 29}), folder_.Sub("cli"), 3, 8));
  std::vector<image::RgbaImage> images;
  for (const std::string renderer : {"cpu", "egl"}) {
    const std::string png = folder_.Sub(renderer + ".png");
    const testing::CommandResult drawn =
        testing::RunIsoscope({"render", folder_.Sub("cli"), "--isovalue", "128", "--renderer",
                              renderer, "--width", "80", "--height", "60", "--color-by",
                              "gradient:turbo::0.3,1", "--light", "1,1,2", "--output", png});
    ASSERT_EQ(drawn.exit_code, 0) << drawn.err;
    const testing::CommandResult again =
        testing::RunIsoscope({"render", folder_.Sub("cli"), "--like", png, "--renderer", renderer,
                              "--output", folder_.Sub("again.png")});
    ASSERT_EQ(again.exit_code, 0) << again.err;
    EXPECT_THAT(again.out, HasSubstr("byte for byte"));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, io::ReadWholeFile(png, 1 << 20));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(images.emplace_back(), image::DecodePng(bytes));
  }
  EXPECT_TRUE(images[0].pixels == images[1].pixels) << "the CPU draws it for both";
  const testing::CommandResult info = testing::RunIsoscope({"info", folder_.Sub("cli")});
  EXPECT_THAT(info.out, HasSubstr("gradient      at most "));
}

// Symptom: agents with `egl` gave the caps of such frames the margin and the tie rule of OpenGL,
// and the triangles those of the CPU. At some rims the caps were an eighth of a pixel too wide.
TEST_F(GradientTest, CapsFollowTheBackEndThatDrawsTheFrame) {
  ISOSCOPE_ASSERT_OK(
      testing::MakeDataset(testing::GyroidVolume({43, 37, 29}), folder_.Sub("caps"), 3, 8));
  for (const std::string plane : {"1,0.3,0.2,-20", "0.2,-0.7,1,-3.3", "-1,0.4,-0.6,31.7"}) {
    std::vector<std::string> files;
    for (const std::string renderer : {"cpu", "egl"}) {
      const std::string png = folder_.Sub(renderer + ".png");
      const testing::CommandResult drawn =
          testing::RunIsoscope({"render",       folder_.Sub("caps"),
                                "--isovalue",   "128",
                                "--renderer",   renderer,
                                "--width",      "300",
                                "--height",     "300",
                                "--azimuth",    "37",
                                "--color-by",   "gradient:turbo",
                                "--clip-plane", plane,
                                "--caps",       "--no-metadata",
                                "--output",     png});
      ASSERT_EQ(drawn.exit_code, 0) << drawn.err;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(files.emplace_back(), io::ReadWholeFile(png, 1 << 20));
    }
    EXPECT_TRUE(files[0] == files[1]) << plane;
  }
}

}  // namespace
}  // namespace isoscope
