// Caps of clip planes: solids of known shape, and random ones against rays that look for the first
// point inside. tests/integration/exact_picture_test.cc has caps in its random requests.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/random.h"
#include "core/base/status_macros.h"
#include "core/extract/cell_inside.h"
#include "core/partition/partitioner.h"
#include "core/picture/color_map.h"
#include "core/render/renderer_factory.h"
#include "core/view/clip_crossings.h"
#include "core/view/unprojection.h"
#include "core/volume/field_gradient.h"
#include "tests/support/draws.h"
#include "tests/support/local_cluster.h"
#include "tests/support/memory_source.h"
#include "tests/support/scenes.h"
#include "tests/support/status_matchers.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/temp_dir.h"

namespace isoscope {
namespace {

using math::Vec3d;
using testing::LocalCluster;

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr std::uint64_t kViewCount = 6;
#else
constexpr std::uint64_t kViewCount = 40;
#endif

struct Volume {
  std::string name;
  volume::GridGeometry geometry;
  volume::ScalarType type = volume::ScalarType::kFloat32;
  std::string samples;

  [[nodiscard]] double At(const math::Index3& p) const {
    const math::Index3& dims = geometry.sample_dims;
    const auto i = static_cast<std::size_t>(p.x + dims.x * (p.y + dims.y * p.z));
    return volume::VisitScalarType(type, [&]<typename T>() {
      return static_cast<double>(base::LoadLittleEndian<T>(samples.data() + i * sizeof(T)));
    });
  }
};

Volume MakeVolume(const std::string& name, const math::Index3& dims, const testing::Field& field) {
  Volume volume{.name = name, .geometry = {}, .samples = {}};
  volume.geometry.sample_dims = dims;
  for (std::int64_t z = 0; z < dims.z; ++z) {
    for (std::int64_t y = 0; y < dims.y; ++y) {
      for (std::int64_t x = 0; x < dims.x; ++x) {
        base::AppendLittleEndian(
            static_cast<float>(
                field({static_cast<double>(x), static_cast<double>(y), static_cast<double>(z)})),
            &volume.samples);
      }
    }
  }
  return volume;
}

// The distance to a sphere in the middle, 20 at its centre; the level L is a sphere of 20 - L.
Volume Ball() {
  return MakeVolume("ball", {49, 49, 49}, [](const Vec3d& p) {
    return 20 - math::Length(p - Vec3d{24, 24, 24});
  });
}

// Inside everywhere: no triangle.
Volume Solid() {
  return MakeVolume("solid", {33, 29, 25}, [](const Vec3d& p) { return 100 + p.x; });
}

// A random field whose border is outside, so that its solid is closed.
Volume Closed(const std::string& name, std::uint64_t seed, double max_wave_number) {
  const math::Index3 dims{29, 26, 23};
  const std::string noise =
      max_wave_number > 0 ? testing::SampleField(testing::RandomField(seed, 40, max_wave_number),
                                                 dims, volume::ScalarType::kFloat32, 1, 0)
                          : testing::SampleNoise(seed, dims, volume::ScalarType::kFloat32, 4);
  std::size_t i = 0;
  return MakeVolume(name, dims, [&](const Vec3d& p) {
    const float value = base::LoadLittleEndian<float>(noise.data() + sizeof(float) * i++);
    const bool is_border = p.x == 0 || p.y == 0 || p.z == 0 || p.x == 28 || p.y == 25 || p.z == 22;
    return is_border ? -9.0 : static_cast<double>(value);
  });
}

class CapsTest : public ::testing::TestWithParam<render::RendererKind> {
 protected:
  void SetUp() override {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        renderer_, testing::MakeSharedRenderer(GetParam(), testing::DrawSeed("renderer")));
    clusters_.emplace(renderer_.get(), testing::DrawSeed());
  }

  [[nodiscard]] static bool is_egl() { return GetParam() == render::RendererKind::kEgl; }

  // Wakes the cluster, with threads and limits at random. It sleeps at the next call.
  absl::StatusOr<LocalCluster*> Get(const Volume& volume, std::int64_t edge, int shard_count) {
    std::string& directory = directories_[{volume.name, edge, shard_count}];
    if (directory.empty()) {
      partition::PartitionOptions options;
      options.output_directory = temp_.Sub(absl::StrCat("d", directories_.size()));
      options.shard_count = shard_count;
      options.block_cells = {edge, edge, edge};
      const auto source =
          testing::MakeMemorySource(volume.geometry, volume.type, volume.samples, volume.name);
      ISOSCOPE_RETURN_IF_ERROR(
          partition::Partition(*source, options, base::Cancellation()).status());
      directory = options.output_directory;
    }
    return clusters_->Wake(directory);
  }

  // Renders the frame with every culling, on one to three agents and with other blocks, and
  // compares the pictures. Returns that without culling.
  absl::StatusOr<image::FrameImage> RenderAlike(const Volume& volume, frame::FrameSpec spec) {
    std::optional<image::FrameImage> first;
    for (const auto& [edge, shard_count] :
         {std::pair(8, 1), std::pair(8, 2), std::pair(8, 3), std::pair(5, 2)}) {
      for (const frame::Culling culling :
           {frame::Culling::kNone, frame::Culling::kDepth, frame::Culling::kMask}) {
        if ((culling == frame::Culling::kMask && HasTriangles(volume)) || (is_egl() && edge != 8)) {
          continue;
        }
        ISOSCOPE_ASSIGN_OR_RETURN(LocalCluster* const cluster, Get(volume, edge, shard_count));
        spec.culling = culling;
        ISOSCOPE_ASSIGN_OR_RETURN(server::FrameResult result, cluster->Render(spec));
        if (!first) {
          first = std::move(result.image);
          continue;
        }
        const testing::Difference difference = testing::Compare(*first, result.image);
        EXPECT_EQ(difference.colors, 0) << edge << ", " << shard_count << ", " << cluster->limits();
        EXPECT_EQ(difference.depths, 0) << edge << ", " << shard_count << ", " << cluster->limits();
      }
    }
    return *std::move(first);
  }

  static bool HasTriangles(const Volume& volume) { return volume.name != "solid"; }

  testing::TempDir temp_;
  std::map<std::tuple<std::string, std::int64_t, int>, std::string> directories_;
  std::unique_ptr<render::Renderer> renderer_;  // null: clusters make a CPU renderer
  std::optional<testing::LocalClusters> clusters_;
};

// From +x to the middle of a ball, z up, 48 units high: 192 pixels.
frame::FrameSpec BallFromX(double isovalue) {
  frame::FrameSpec spec;
  spec.surfaces = {{.rule = {.isovalue = isovalue}, .appearance = {}}};
  view::Camera& camera = spec.camera.emplace();
  camera.eye = {200, 24, 24};
  camera.target = {24, 24, 24};
  camera.up = {0, 0, 1};
  camera.projection = view::Projection::kOrthographic;
  camera.view_height = 48;
  spec.viewport = {192, 192};
  spec.clip.half_spaces = {{{-1, 0, 0}, -24.3}};
  spec.caps.emplace();
  return spec;
}

double RadiusOf(int x, int y) { return std::hypot(x + 0.5 - 96, y + 0.5 - 96) / 4; }

TEST_P(CapsTest, ACutBallShowsADiscAndNothingElse) {
  const Volume ball = Ball();
  const frame::FrameSpec spec = BallFromX(4);  // of radius 16
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage image, RenderAlike(ball, spec));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const view::View view,
                                view::View::Make(*spec.camera, spec.viewport, ball.geometry));
  const view::Unprojection unprojection(view);
  const double rim = std::sqrt(16.0 * 16 - 0.3 * 0.3);
  for (int y = 0; y < 192; ++y) {
    for (int x = 0; x < 192; ++x) {
      const std::size_t i = image.IndexOf(x, y);
      const bool is_covered = image.keys[i] != image::kBackgroundKey;
      if (RadiusOf(x, y) < rim - 0.1) {
        ASSERT_TRUE(is_covered) << x << ", " << y;
        EXPECT_NEAR(static_cast<double>(unprojection.DistanceOf(image::DepthOf(image.keys[i]))),
                    200 - 24.3, 1e-3);
        EXPECT_EQ(image.colors[i], image.colors[image.IndexOf(96, 96)]);
      } else if (RadiusOf(x, y) > rim + 0.1) {
        // Behind the cut the ball has its full radius no more.
        ASSERT_FALSE(is_covered && RadiusOf(x, y) > 16.05) << x << ", " << y;
      }
    }
  }
}

TEST_P(CapsTest, OfNestedSurfacesTheHighestIsovalueShows) {
  const Volume ball = Ball();
  for (const bool is_inner_first : {false, true}) {
    frame::FrameSpec spec = BallFromX(4);
    spec.surfaces.resize(3);
    spec.surfaces[is_inner_first ? 0 : 1].rule.isovalue = 12;
    spec.surfaces[is_inner_first ? 1 : 0].rule.isovalue = 4;
    spec.surfaces[2].rule.isovalue = 8;
    spec.surfaces[2].opacity = 0.5F;  // clipped, but not filled
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage image, RenderAlike(ball, spec));
    const image::FragmentOrder order{.block_count = 6 * 6 * 6};
    for (int y = 0; y < 192; ++y) {
      for (int x = 0; x < 192; ++x) {
        const double radius = RadiusOf(x, y);
        if (radius > 15.9 || std::abs(radius - 8) < 0.1) {
          continue;
        }
        const std::uint32_t shown =
            order.SurfaceOf(image::OwnerOf(image.keys[image.IndexOf(x, y)]));
        EXPECT_EQ(shown, (radius < 8) == is_inner_first ? 0U : 1U) << x << ", " << y;
      }
    }
  }
}

// The clip region is all that can be seen of a volume that is inside everywhere: each ray that
// meets it shows the border that it enters.
TEST_P(CapsTest, AVolumeThatIsInsideEverywhereShowsTheBordersOfItsPart) {
  const Volume solid = Solid();
  std::vector<view::ClipRegion> regions(3);
  regions[0].half_spaces = {{{1, 1, 1}, 40}};
  regions[1].half_spaces = {{{1, 2, 3}, 80}, {{-1, -2, -3}, -80.5}};  // a thin slab
  regions[2].box = math::Box3d{{5, 4, 3}, {21.5, 20, 24}};            // one face on the border
  for (std::size_t k = 0; k < regions.size(); ++k) {
    for (std::uint64_t seed = 1; seed <= kViewCount / 4; ++seed) {
      SCOPED_TRACE(absl::StrCat("region ", k, ", seed ", seed));
      frame::FrameSpec spec = testing::RandomSpec(seed, solid.geometry.Bounds(), 50);
      spec.clip = regions[k];
      spec.caps.emplace();
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage image, RenderAlike(solid, spec));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const view::View view,
                                    view::View::Make(*spec.camera, spec.viewport, solid.geometry));
      const view::ClipCrossingFinder finder(view, view::Clipper(spec.clip, solid.geometry));
      for (int y = 0; y < image.height; ++y) {
        for (int x = 0; x < image.width; ++x) {
          const view::ClipCrossings crossings = finder.At(x + 0.5, y + 0.5);
          const auto& first = crossings.entry ? crossings.entry : crossings.exit;
          const std::uint64_t key = image.keys[image.IndexOf(x, y)];
          ASSERT_EQ(key != image::kBackgroundKey, first.has_value()) << x << ", " << y;
          if (first.has_value()) {
            EXPECT_EQ(image::DepthOf(key), first->depth);
          }
        }
      }
    }
  }
}

TEST_P(CapsTest, SamplesShowThroughTheMap) {
  const Volume solid = Solid();
  frame::FrameSpec spec;
  spec.surfaces = {{.rule = {.isovalue = 50}, .appearance = {}}};
  view::Camera& camera = spec.camera.emplace();
  camera.eye = {16, 14, 100};
  camera.target = {16, 14, 12};
  camera.up = {0, 1, 0};
  camera.projection = view::Projection::kOrthographic;
  camera.view_height = 32;
  spec.viewport = {80, 64};  // two pixels a unit
  spec.clip.half_spaces = {{{0, 0, -1}, -12.5}};
  spec.caps = frame::ClipCaps{.map = frame::ColorMap::kViridis};
  const picture::ColorMapTable& table = picture::ColorMapTableOf(frame::ColorMap::kViridis);
  // The samples are x + 100, x from 0 to 32.
  for (const frame::ColorRange range : {frame::ColorRange{100, 132}, frame::ColorRange{110, 120}}) {
    spec.caps->range = range;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage image, RenderAlike(solid, spec));
    int count = 0;
    for (int y = 0; y < 64; ++y) {
      for (int x = 0; x < 80; ++x) {
        const std::size_t i = image.IndexOf(x, y);
        if (image.keys[i] != image::kBackgroundKey) {
          const double value = 100 + (x + 0.5 - 8) / 2;
          EXPECT_EQ(image.colors[i], table[picture::ColorMapStepOf(value, range)]) << x;
          ++count;
        }
      }
    }
    EXPECT_EQ(count, 64 * 56);
  }
}

// Looks along the rays of a picture for points that are inside.
class RayWalk {
 public:
  RayWalk(const Volume& volume, const view::View& view, const frame::FrameSpec& spec)
      : volume_(volume),
        layout_(volume::BlockLayout::Make(volume.geometry.sample_dims, {8, 8, 8}).value()),
        view_(view),
        unprojection_(view),
        clipper_(spec.clip, volume.geometry),
        isovalue_(spec.surfaces[0].rule.isovalue) {}

  // Whether the point at a distance is in the solid and the clip region, by a margin in samples.
  [[nodiscard]] bool IsInside(double x, double y, double distance, double margin) const {
    const view::Camera& camera = view_.camera();
    const bool is_perspective = camera.projection == view::Projection::kPerspective;
    const double half_height =
        is_perspective ? std::tan(camera.fov_y_radians / 2) : camera.view_height / 2;
    const double pixel = 2 * half_height / view_.viewport().height_px;
    const Vec3d spread = view_.right() * (pixel * (x - 0.5 * view_.viewport().width_px)) -
                         view_.up() * (pixel * (y - 0.5 * view_.viewport().height_px));
    const Vec3d world = is_perspective ? camera.eye + (view_.forward() + spread) * distance
                                       : camera.eye + spread + view_.forward() * distance;
    const Vec3d p = math::TransformPoint(view_.index_from_world(), world);
    for (int axis = 0; axis < 3; ++axis) {
      if (p[axis] < 0 || p[axis] > static_cast<double>(volume_.geometry.sample_dims[axis] - 1)) {
        return false;
      }
    }
    for (const view::HalfSpace& half_space : clipper_.half_spaces()) {
      if (math::Dot(half_space.normal, p) - half_space.offset <
          margin * math::Length(half_space.normal)) {
        return false;
      }
    }
    const math::Index3 cell = volume::CellAt(layout_, p);
    std::array<double, 8> corners;
    for (std::size_t c = 0; c < 8; ++c) {
      const auto i = static_cast<std::int64_t>(c);
      corners[c] = volume_.At(cell + math::Index3{i & 1, i >> 1 & 1, i >> 2});
    }
    return extract::IsInsideCell(corners, cell, p, isovalue_);
  }

  [[nodiscard]] const view::Unprojection& unprojection() const { return unprojection_; }

 private:
  const Volume& volume_;
  const volume::BlockLayout layout_;
  const view::View& view_;
  const view::Unprojection unprojection_;
  const view::Clipper clipper_;
  const double isovalue_;
};

// Half-spaces through random points of the volume's middle.
view::ClipRegion RandomClip(std::uint64_t seed, const math::Box3d& bounds) {
  std::uint64_t counter = 0;
  const auto random = [&] { return base::RandomUnit(seed, 900'000 + counter++); };
  view::ClipRegion clip;
  const int count = 1 + static_cast<int>(3 * random());
  for (int i = 0; i < count; ++i) {
    Vec3d normal{random() - 0.5, random() - 0.5, random() - 0.5};
    Vec3d point;
    for (int axis = 0; axis < 3; ++axis) {
      point[axis] =
          bounds.min[axis] + (bounds.max[axis] - bounds.min[axis]) * (0.25 + 0.5 * random());
    }
    if (random() < 0.3) {
      normal = {0, 0, random() < 0.5 ? -1.0 : 1.0};
      point.z = std::round(point.z);  // a plane of samples
    }
    clip.half_spaces.push_back({normal, math::Dot(normal, point)});
  }
  return clip;
}

// A driver of OpenGL may place a fragment by a part of a pixel.
class CpuCapsTest : public CapsTest {};

TEST_P(CpuCapsTest, NoRayLooksThroughTheRimOfACap) {
  std::int64_t inside_count = 0;
  std::int64_t cap_count = 0;
  for (const auto& [volume, isovalue] :
       {std::pair(Closed("smooth", 3, 3.0), 0.0), std::pair(Closed("noise", 5, 0), 2.0)}) {
    for (std::uint64_t seed = 1; seed <= kViewCount; ++seed) {
      SCOPED_TRACE(absl::StrCat(volume.name, ", seed ", seed));
      const math::Box3d bounds = volume.geometry.Bounds();
      frame::FrameSpec spec = testing::RandomSpec(seed, bounds, isovalue);
      // From outside, so that nothing is cut by the near plane.
      view::Camera& camera = *spec.camera;
      camera.target = bounds.Center();
      camera.eye =
          camera.target + math::Normalized(camera.eye - camera.target) * (2.5 * bounds.Radius());
      camera.fov_y_radians = 0.5;
      camera.view_height = 1.2 * bounds.Radius();
      spec.clip = RandomClip(seed, bounds);
      spec.caps.emplace();
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(LocalCluster* const cluster, Get(volume, 8, 2));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult result, cluster->Render(spec));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const view::View view,
                                    view::View::Make(camera, spec.viewport, volume.geometry));
      const view::ClipCrossingFinder finder(view, view::Clipper(spec.clip, volume.geometry));
      const RayWalk walk(volume, view, spec);
      for (int y = 0; y < result.image.height; ++y) {
        for (int x = 0; x < result.image.width; ++x) {
          const std::uint64_t key = result.image.keys[result.image.IndexOf(x, y)];
          const bool is_shown = key != image::kBackgroundKey;
          const double shown =
              is_shown ? static_cast<double>(walk.unprojection().DistanceOf(image::DepthOf(key)))
                       : view.far_distance();
          const view::ClipCrossings crossings = finder.At(x + 0.5, y + 0.5);
          cap_count +=
              is_shown && crossings.entry && image::DepthOf(key) == crossings.entry->depth ? 1 : 0;
          // Nothing in front of what shows is inside, neither on the ray nor right beside it.
          constexpr double kStep = 0.09;
          for (double d = view.near_distance(); d < shown - 0.02; d += kStep) {
            const auto is_inside = [&](double dx, double dy) {
              return walk.IsInside(x + 0.5 + dx, y + 0.5 + dy, d, 1e-3);
            };
            if (!is_inside(0, 0)) {
              continue;
            }
            // Within 1/100 of a pixel of an edge either may be covered.
            if (is_inside(0.01, 0.01) && is_inside(-0.01, 0.01) && is_inside(0.01, -0.01) &&
                is_inside(-0.01, -0.01)) {
              ADD_FAILURE() << "pixel " << x << ", " << y << " shows "
                            << (is_shown ? absl::StrCat("what is at ", shown) : "nothing")
                            << ", but is inside at " << d;
              break;
            }
          }
          inside_count += is_shown ? 1 : 0;
        }
      }
      if (HasFailure()) {
        return;
      }
    }
  }
  // Defends the test.
  EXPECT_GT(inside_count, static_cast<std::int64_t>(kViewCount) * 1000);
  EXPECT_GT(cap_count, static_cast<std::int64_t>(kViewCount) * 200);
}

INSTANTIATE_TEST_SUITE_P(BackEnds, CapsTest,
                         ::testing::Values(render::RendererKind::kEgl, render::RendererKind::kCpu),
                         [](const auto& back_end) {
                           return back_end.param == render::RendererKind::kEgl ? "Egl" : "Cpu";
                         });
INSTANTIATE_TEST_SUITE_P(Cpu, CpuCapsTest, ::testing::Values(render::RendererKind::kCpu),
                         [](const auto& /*back_end*/) { return "Cpu"; });

}  // namespace
}  // namespace isoscope
