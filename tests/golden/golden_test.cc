// Pictures that were looked at once and must not change by accident. That pictures are right is
// proved elsewhere (exact_picture_test, extraction against a reference); these guard against
// change: of the camera, the shading, the side that is lit, the seams.
//
// Tolerance: between versions of Mesa and compilers an interpolated colour is rounded differently
// by a level or two, and a pixel whose sample lies on an edge falls to the other side. So a pixel
// counts as different only beyond kMaxLevelDifference, and a few on silhouettes may be. A change
// that a person can see (a seam, light from elsewhere, a shift by half a pixel) moves far more.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/base/units.h"
#include "core/composite/depth_composite.h"
#include "core/image/png_codec.h"
#include "core/io/file.h"
#include "core/partition/partitioner.h"
#include "core/render/renderer_factory.h"
#include "core/source/volume_source.h"
#include "tests/support/local_cluster.h"
#include "tests/support/memory_source.h"
#include "tests/support/status_matchers.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/temp_dir.h"

namespace isoscope {
namespace {

// Levels out of 255.
constexpr int kMaxLevelDifference = 6;
// Share of all pixels: silhouettes of these pictures take some percent of them.
constexpr double kMaxDifferentShare = 0.003;
// Mean over pixels and channels, in levels: a slight but wide change of the shading.
constexpr double kMaxMeanDifference = 0.25;
constexpr std::int64_t kMaxPngBytes = base::kMiB;

struct Scene {
  std::string name{};
  volume::ScalarType type = volume::ScalarType::kUint8;
  volume::GridGeometry geometry{};
  std::string samples{};
  frame::FrameSpec request{};
};

frame::FrameSpec MakeRequest(const volume::GridGeometry& geometry, double isovalue,
                             double azimuth_degrees, double elevation_degrees) {
  constexpr double kRadians = std::numbers::pi / 180;
  frame::FrameSpec request;
  request.surfaces.resize(1);
  request.surfaces[0].rule.isovalue = isovalue;
  request.camera = view::MakeDefaultCamera(geometry.Bounds());
  view::Azimuth(azimuth_degrees * kRadians, &*request.camera);
  view::Elevation(elevation_degrees * kRadians, &*request.camera);
  view::OrthogonalizeUp(&*request.camera);
  request.viewport = {256, 192};
  return request;
}

// uint8 and blocks that cut sheets: seams would show.
Scene Gyroid() {
  const math::Index3 dims{65, 65, 65};
  Scene scene{.name = "gyroid"};
  scene.geometry.sample_dims = dims;
  scene.samples = testing::SampleField(testing::GyroidField(2), dims, scene.type, 80, 128);
  scene.request = MakeRequest(scene.geometry, 128, 30, 20);
  return scene;
}

// float32, close to the limit of the sampling, from above.
Scene MarschnerLobb() {
  const math::Index3 dims{72, 72, 72};
  Scene scene{.name = "marschner_lobb", .type = volume::ScalarType::kFloat32};
  scene.geometry.sample_dims = dims;
  scene.samples =
      testing::SampleField(testing::MarschnerLobbField(6, 0.25), dims, scene.type, 1, 0);
  scene.request = MakeRequest(scene.geometry, 0.5, 20, 40);
  scene.request.camera->fov_y_radians /= 1.3;
  return scene;
}

// A torus on a grid with other spacing on each axis: it must look round.
Scene Torus(view::Projection projection) {
  const math::Index3 dims{81, 61, 41};
  Scene scene{.name = projection == view::Projection::kPerspective ? "torus_perspective"
                                                                   : "torus_orthographic"};
  scene.geometry.sample_dims = dims;
  scene.geometry.spacing = {2.0 / 80, 2.0 / 60, 2.0 / 40};
  scene.geometry.origin = {-1, -1, -1};
  scene.samples = testing::SampleField(testing::TorusField(0.6, 0.25), dims, scene.type, 300, 128);
  scene.request = MakeRequest(scene.geometry, 128, -35, 25);
  if (projection == view::Projection::kPerspective) {
    // From near: what is closer must look larger.
    scene.request.camera->eye = scene.request.camera->eye * 0.28;
    scene.request.camera->fov_y_radians = 75 * std::numbers::pi / 180;
  } else {
    scene.request.camera->projection = view::Projection::kOrthographic;
    scene.request.camera->view_height = 2.0;
  }
  scene.request.surfaces[0].appearance.base_color = {70, 130, 220, 255};
  return scene;
}

absl::StatusOr<image::RgbaImage> Render(const Scene& scene, render::RendererKind kind) {
  testing::TempDir directory;
  const auto source =
      testing::MakeMemorySource(scene.geometry, scene.type, scene.samples, scene.name);
  partition::PartitionOptions options;
  options.output_directory = directory.Sub("d");
  options.shard_count = 3;
  absl::StatusOr<store::Manifest> manifest =
      partition::Partition(*source, options, base::Cancellation());
  if (!manifest.ok()) {
    return manifest.status();
  }
  absl::StatusOr<std::unique_ptr<render::Renderer>> renderer = render::MakeRenderer({.kind = kind});
  if (!renderer.ok()) {
    return renderer.status();
  }
  auto cluster = testing::LocalCluster::Open(options.output_directory, renderer->get(), {});
  if (!cluster.ok()) {
    return cluster.status();
  }
  absl::StatusOr<server::FrameResult> result = (*cluster)->Render(scene.request);
  if (!result.ok()) {
    return result.status();
  }
  image::FrameImage& image = result->image;
  composite::FlattenOver(image::Rgba8{0, 0, 0, 255}, &image);
  return image::RgbaImage{.width = image.width,
                          .height = image.height,
                          .pixels = {image.colors.begin(), image.colors.end()}};
}

struct Comparison {
  int max_difference = 0;  // levels of a channel
  int different_pixel_count = 0;
  double different_share = 0;  // of pixels that differ by more than kMaxLevelDifference
  double mean_difference = 0;
  std::vector<image::Rgba8> amplified;  // the difference, eight times
};

Comparison Compare(const image::RgbaImage& a, const image::RgbaImage& b) {
  Comparison comparison;
  std::int64_t sum = 0;
  std::int64_t different = 0;
  for (std::size_t i = 0; i < a.pixels.size(); ++i) {
    const image::Rgba8& p = a.pixels[i];
    const image::Rgba8& q = b.pixels[i];
    const int levels[3] = {std::abs(p.r - q.r), std::abs(p.g - q.g), std::abs(p.b - q.b)};
    sum += levels[0] + levels[1] + levels[2];
    const int most = *std::max_element(levels, levels + 3);
    comparison.max_difference = std::max(comparison.max_difference, most);
    comparison.different_pixel_count += most > 0 ? 1 : 0;
    different += most > kMaxLevelDifference ? 1 : 0;
    const auto amplify = [](int level) {
      return static_cast<std::uint8_t>(std::min(8 * level, 255));
    };
    comparison.amplified.push_back(
        {amplify(levels[0]), amplify(levels[1]), amplify(levels[2]), 255});
  }
  const auto count = static_cast<double>(a.pixels.size());
  comparison.different_share = static_cast<double>(different) / count;
  comparison.mean_difference = static_cast<double>(sum) / (3 * count);
  return comparison;
}

void Replace(const std::string& path, const std::string& bytes) {
  ISOSCOPE_ASSERT_OK(io::RemoveRecursively(path));
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(path, bytes));
}

// Writes what was drawn and the difference beside a copy of what was expected.
void SaveFailure(const std::string& name, const image::RgbaImage& actual,
                 const std::string& expected_png, const std::vector<image::Rgba8>& difference) {
  const std::filesystem::path folder = ISOSCOPE_GOLDEN_FAILURE_DIR;
  std::filesystem::create_directories(folder);
  Replace(folder / (name + ".actual.png"),
          image::EncodePng(actual.width, actual.height, actual.pixels));
  Replace(folder / (name + ".expected.png"), expected_png);
  Replace(folder / (name + ".difference.png"),
          image::EncodePng(actual.width, actual.height, difference));
  ADD_FAILURE() << "look at " << folder.string() << "/" << name
                << ".{expected,actual,difference}.png\n"
                   "if the new picture is right: tools/regenerate_golden.sh, and look again";
}

// A run that writes pictures compares nothing, and so must not pass for a test.
constexpr char kRegenerated[] =
    "ISOSCOPE_REGENERATE_GOLDEN is set: pictures were written and none compared";

void CheckScene(const Scene& scene, render::RendererKind kind) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::RgbaImage actual, Render(scene, kind));
  const std::string path = absl::StrCat(ISOSCOPE_GOLDEN_DIR, "/", scene.name, ".png");
  // NOLINTNEXTLINE(concurrency-mt-unsafe): nobody sets any
  if (std::getenv("ISOSCOPE_REGENERATE_GOLDEN") != nullptr) {
    if (kind == render::RendererKind::kEgl) {
      Replace(path, image::EncodePng(actual.width, actual.height, actual.pixels));
    }
    ADD_FAILURE() << kRegenerated;
    return;
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string png, io::ReadWholeFile(path, kMaxPngBytes));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::RgbaImage expected, image::DecodePng(png));
  ASSERT_EQ(actual.width, expected.width);
  ASSERT_EQ(actual.height, expected.height);
  const Comparison comparison = Compare(actual, expected);
  ::testing::Test::RecordProperty("max_difference", comparison.max_difference);
  ::testing::Test::RecordProperty("different_pixel_count", comparison.different_pixel_count);
  EXPECT_LE(comparison.different_share, kMaxDifferentShare);
  EXPECT_LE(comparison.mean_difference, kMaxMeanDifference);
  if (::testing::Test::HasFailure()) {
    SaveFailure(scene.name, actual, png, comparison.amplified);
  }
}

// Both back ends against the same pictures: they must agree, too.
class GoldenTest : public ::testing::TestWithParam<render::RendererKind> {};

TEST_P(GoldenTest, Gyroid) { CheckScene(Gyroid(), GetParam()); }
TEST_P(GoldenTest, MarschnerLobb) { CheckScene(MarschnerLobb(), GetParam()); }
TEST_P(GoldenTest, TorusInPerspective) {
  CheckScene(Torus(view::Projection::kPerspective), GetParam());
}
TEST_P(GoldenTest, TorusInOrthographicProjection) {
  CheckScene(Torus(view::Projection::kOrthographic), GetParam());
}

INSTANTIATE_TEST_SUITE_P(BackEnds, GoldenTest,
                         ::testing::Values(render::RendererKind::kEgl, render::RendererKind::kCpu),
                         [](const auto& back_end) {
                           return back_end.param == render::RendererKind::kEgl ? "Egl" : "Cpu";
                         });

}  // namespace
}  // namespace isoscope
