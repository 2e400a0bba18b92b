// The product's promise: the picture with CULLING_DEPTH is that of CULLING_NONE, bit for bit in
// colour, depth and owner, for any number of agents, any distribution and any block size.

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <numbers>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/random.h"
#include "core/ingest/partitioner.h"
#include "core/ingest/volume_source.h"
#include "core/render/renderer_factory.h"
#include "core/volume/synthetic_fields.h"
#include "tests/support/local_cluster.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope {
namespace {

using testing::LocalCluster;

constexpr int kThreadCount = 2;
constexpr int kShardCounts[] = {1, 2, 3, 7, 16};
constexpr std::int64_t kBlockEdges[] = {4, 8, 16, 32};
// Views for each generated field, and for the head. Sanitizers look for other bugs: a few do.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr int kFieldViewCount = 6;
constexpr int kHeadViewCount = 1;
#else
constexpr int kFieldViewCount = 64;
constexpr int kHeadViewCount = 12;
#endif
constexpr char kHeadPath[] = "/usr/share/mricron/templates/ch2.nii.gz";

struct Volume {
  std::string name;
  volume::GridGeometry geometry;
  volume::ScalarType type;
  std::string samples;
  double isovalue;
};

volume::GridGeometry ObliqueGeometry(const math::Index3& dims, const math::Vec3d& spacing) {
  // A turn about z and a shift: nothing may depend on index and world axes being the same.
  const double angle = 0.35;
  volume::GridGeometry geometry;
  geometry.sample_dims = dims;
  geometry.spacing = spacing;
  geometry.origin = {-12.5, 40.0, 3.25};
  geometry.direction.columns = {math::Vec3d{std::cos(angle), std::sin(angle), 0},
                                math::Vec3d{-std::sin(angle), std::cos(angle), 0},
                                math::Vec3d{0, 0, 1}};
  return geometry;
}

Volume Gyroid() {
  const math::Index3 dims{49, 45, 41};
  return {"gyroid", ObliqueGeometry(dims, {1, 1, 1}), volume::ScalarType::kUint8,
          volume::SampleField(volume::GyroidField(3), dims, volume::ScalarType::kUint8, 80, 128),
          128.0};
}

// Whole numbers 0 .. 4 and a whole isovalue: most vertices lie on samples, so sheets touch and
// equal depths are common.
Volume Ties() {
  const math::Index3 dims{26, 29, 31};
  return {"ties", ObliqueGeometry(dims, {1, 1, 1}), volume::ScalarType::kUint16,
          volume::SampleNoise(7, dims, volume::ScalarType::kUint16, 4), 2.0};
}

Volume SmoothRandom() {
  const math::Index3 dims{65, 48, 56};
  return {"smooth_random", ObliqueGeometry(dims, {0.5, 0.75, 2.0}), volume::ScalarType::kFloat32,
          volume::SampleField(volume::RandomField(3, 40, 9.0), dims, volume::ScalarType::kFloat32,
                              1, 0),
          0.05};
}

// A camera that is inside the volume as often as outside, near and far, turned any way.
agent::FrameRequest RandomRequest(std::uint64_t seed, const math::Box3d& bounds, double isovalue) {
  std::uint64_t counter = 0;
  const auto unit = [&] { return base::RandomUnit(seed, counter++); };
  const auto signed_unit = [&] { return 2 * unit() - 1; };
  const auto direction = [&] {
    while (true) {
      const math::Vec3d v{signed_unit(), signed_unit(), signed_unit()};
      if (const double length = math::Length(v); length > 0.1 && length <= 1) {
        return v * (1 / length);
      }
    }
  };
  agent::FrameRequest request;
  request.isovalue = isovalue;
  const double radius = bounds.Radius();
  request.camera.target = bounds.Center() + direction() * (0.5 * radius * unit());
  request.camera.eye = request.camera.target + direction() * (radius * (0.02 + 2.5 * unit()));
  request.camera.up = direction();
  if (unit() < 0.5) {
    request.camera.projection = view::Projection::kPerspective;
    request.camera.fov_y_radians = (5 + 110 * unit()) * std::numbers::pi / 180;
  } else {
    request.camera.projection = view::Projection::kOrthographic;
    request.camera.view_height = radius * (0.1 + 2.5 * unit());
  }
  request.viewport = {32 + static_cast<int>(130 * unit()), 32 + static_cast<int>(130 * unit())};
  request.ray_seed = seed;
  return request;
}

struct Difference {
  std::int64_t colors = 0;
  std::int64_t depths = 0;
  std::int64_t owners = 0;
};

Difference Compare(const image::FrameImage& a, const image::FrameImage& b) {
  Difference difference;
  for (std::size_t i = 0; i < a.pixel_count(); ++i) {
    difference.colors += a.color[i] == b.color[i] ? 0 : 1;
    difference.depths += a.depth[i] == b.depth[i] ? 0 : 1;
    difference.owners += a.block_id[i] == b.block_id[i] ? 0 : 1;
  }
  return difference;
}

std::int64_t TriangleCount(const server::FrameResult& result) {
  std::int64_t count = 0;
  for (const server::AgentStatistics& agent : result.agents) {
    count += agent.triangle_count;
  }
  return count;
}

std::int64_t CoveredPixels(const image::FrameImage& image) {
  std::int64_t count = 0;
  for (const std::uint32_t owner : image.block_id) {
    count += owner == image::kNoBlock ? 0 : 1;
  }
  return count;
}

// Datasets of a volume, cut as asked for, each made once.
class Datasets {
 public:
  Datasets(const Volume& volume, render::Renderer* renderer)
      : volume_(volume), renderer_(renderer) {}

  absl::StatusOr<LocalCluster*> Get(std::int64_t edge, int shard_count,
                                    store::Distribution distribution) {
    std::unique_ptr<LocalCluster>& cluster = clusters_[{edge, shard_count, distribution}];
    if (cluster == nullptr) {
      const auto source =
          ingest::MakeMemorySource(volume_.geometry, volume_.type, volume_.samples, volume_.name);
      ingest::PartitionOptions options;
      options.output_directory = directory_.Sub("d" + std::to_string(clusters_.size()));
      options.shard_count = shard_count;
      options.block_cells = {edge, edge, edge};
      options.distribution = distribution;
      absl::StatusOr<store::Manifest> manifest =
          ingest::Partition(*source, options, base::Cancellation());
      if (!manifest.ok()) {
        return manifest.status();
      }
      absl::StatusOr<std::unique_ptr<LocalCluster>> opened =
          LocalCluster::Open(options.output_directory, renderer_, kThreadCount);
      if (!opened.ok()) {
        return opened.status();
      }
      cluster = *std::move(opened);
    }
    return cluster.get();
  }

  [[nodiscard]] std::int64_t BlockCount(std::int64_t edge) const {
    return volume::BlockLayout::Make(volume_.geometry.sample_dims, {edge, edge, edge})
        ->block_count();
  }

 private:
  const Volume& volume_;
  render::Renderer* const renderer_;
  testing::TempDir directory_;
  std::map<std::tuple<std::int64_t, int, store::Distribution>, std::unique_ptr<LocalCluster>>
      clusters_;
};

class ExactPictureTest : public ::testing::TestWithParam<render::RendererKind> {
 protected:
  void SetUp() override {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(renderer_, render::MakeRenderer({.kind = GetParam()}));
  }

  // Renders `camera_count` random views; for each, every shard count against CULLING_NONE of one
  // shard.
  void CheckRandomViews(const Volume& volume, int camera_count, std::uint64_t first_seed) {
    Datasets datasets(volume, renderer_.get());
    std::int64_t covered_pixel_count = 0;
    std::int64_t culled_view_count = 0;
    for (int i = 0; i < camera_count; ++i) {
      const std::uint64_t seed = first_seed + static_cast<std::uint64_t>(i);
      const std::int64_t edge = kBlockEdges[i % 4];
      agent::FrameRequest request = RandomRequest(seed, volume.geometry.Bounds(), volume.isovalue);
      SCOPED_TRACE(volume.name + ", seed " + std::to_string(seed) + ", block edge " +
                   std::to_string(edge));

      ISOSCOPE_ASSERT_OK_AND_ASSIGN(LocalCluster* const one,
                                    datasets.Get(edge, 1, store::Distribution::kRandom));
      request.culling = visibility::Culling::kNone;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult reference, one->Render(request));
      covered_pixel_count += CoveredPixels(reference.image);

      request.culling = visibility::Culling::kDepth;
      std::int64_t triangle_count_of_one = -1;
      for (const int shard_count : kShardCounts) {
        if (shard_count > datasets.BlockCount(edge)) {
          continue;
        }
        const auto distribution = (i + shard_count) % 2 == 0 ? store::Distribution::kRandom
                                                             : store::Distribution::kGreedy;
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(LocalCluster* const cluster,
                                      datasets.Get(edge, shard_count, distribution));
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult result, cluster->Render(request));
        const Difference difference = Compare(reference.image, result.image);
        EXPECT_EQ(difference.colors, 0) << shard_count << " shards";
        EXPECT_EQ(difference.depths, 0) << shard_count << " shards";
        EXPECT_EQ(difference.owners, 0) << shard_count << " shards";
        const std::int64_t triangle_count = TriangleCount(result);
        if (triangle_count_of_one < 0) {
          triangle_count_of_one = triangle_count;
          culled_view_count += triangle_count < TriangleCount(reference) ? 1 : 0;
        }
        EXPECT_EQ(triangle_count, triangle_count_of_one)
            << "what is culled depends on the number of shards: " << shard_count;
      }
      if (HasFailure()) {
        return;
      }
    }
    // Defends the test: empty pictures and views where nothing is culled would prove nothing.
    EXPECT_GT(covered_pixel_count, camera_count * 500);
    EXPECT_GE(culled_view_count, (camera_count + 1) / 2);
  }

  std::unique_ptr<render::Renderer> renderer_;
};

TEST_P(ExactPictureTest, CullingByDepthChangesNoPixelOfGeneratedFields) {
  CheckRandomViews(Gyroid(), kFieldViewCount, 1000);
  CheckRandomViews(Ties(), kFieldViewCount, 2000);
  CheckRandomViews(SmoothRandom(), kFieldViewCount, 3000);
}

TEST_P(ExactPictureTest, CullingByDepthChangesNoPixelOfTheMriHead) {
  if (!std::filesystem::exists(kHeadPath)) {
    GTEST_SKIP() << kHeadPath << " is absent: install Debian's mricron-data";
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<ingest::VolumeSource> source,
                                ingest::OpenVolumeFile(kHeadPath));
  Volume head{"ch2", source->geometry(), source->scalar_type(), "", 60.0};
  head.samples.resize(static_cast<std::size_t>(math::Volume(head.geometry.sample_dims)) *
                      volume::SizeOf(head.type));
  ISOSCOPE_ASSERT_OK(source->ReadSlab(0, head.geometry.sample_dims.z, head.samples.data()));
  CheckRandomViews(head, kHeadViewCount, 9000);
}

// A wall of blocks, and small spheres in front of it, each inside a block of its own that few rays
// meet. The paper's mask sees the wall's pixels covered and culls spheres that rays missed.
Volume SpheresBeforeWall() {
  const math::Index3 dims{97, 97, 65};
  std::vector<math::Vec3d> centers;
  for (int i = 0; i < 300; ++i) {
    const auto n = static_cast<std::uint64_t>(i);
    const auto cell = [&](std::uint64_t k, double count) {
      return 4 * std::floor(count * base::RandomUnit(5, 3 * n + k)) + 2;
    };
    centers.push_back({cell(0, 24), cell(1, 24), 8 + cell(2, 12)});
  }
  std::string samples(static_cast<std::size_t>(math::Volume(dims)), '\0');
  for (std::int64_t z = 0; z < dims.z; ++z) {
    for (std::int64_t y = 0; y < dims.y; ++y) {
      for (std::int64_t x = 0; x < dims.x; ++x) {
        double value = z <= 2 ? 200 : 0;
        for (const math::Vec3d& center : centers) {
          const math::Vec3d p{static_cast<double>(x), static_cast<double>(y),
                              static_cast<double>(z)};
          value = std::max(value, 200 - 100 * math::Length(p - center));
        }
        samples[static_cast<std::size_t>(x + dims.x * (y + dims.y * z))] =
            static_cast<char>(static_cast<unsigned char>(std::max(0.0, value)));
      }
    }
  }
  volume::GridGeometry geometry;
  geometry.sample_dims = dims;
  return {"spheres_before_wall", geometry, volume::ScalarType::kUint8, samples, 100.0};
}

TEST_P(ExactPictureTest, CullingByMaskLosesPixelsThatCullingByDepthKeeps) {
  const Volume volume = SpheresBeforeWall();
  Datasets datasets(volume, renderer_.get());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(LocalCluster* const cluster,
                                datasets.Get(4, 3, store::Distribution::kRandom));
  agent::FrameRequest request;
  request.isovalue = volume.isovalue;
  request.viewport = {128, 128};
  request.camera = view::MakeDefaultCamera(volume.geometry.Bounds());
  view::Azimuth(0.3, &request.camera);
  view::Elevation(0.2, &request.camera);
  view::OrthogonalizeUp(&request.camera);

  request.culling = visibility::Culling::kNone;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult reference, cluster->Render(request));
  request.culling = visibility::Culling::kMask;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult masked, cluster->Render(request));
  request.culling = visibility::Culling::kDepth;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult exact, cluster->Render(request));

  EXPECT_GT(Compare(reference.image, masked.image).depths, 0)
      << "the field no longer shows why the mask must carry depth";
  const Difference difference = Compare(reference.image, exact.image);
  EXPECT_EQ(difference.colors, 0);
  EXPECT_EQ(difference.depths, 0);
  EXPECT_EQ(difference.owners, 0);
}

TEST_P(ExactPictureTest, IsovalueOutsideTheDataIsAnEmptyPicture) {
  const Volume volume = Gyroid();
  Datasets datasets(volume, renderer_.get());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(LocalCluster* const cluster,
                                datasets.Get(8, 2, store::Distribution::kRandom));
  agent::FrameRequest request = RandomRequest(1, volume.geometry.Bounds(), 1e6);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult result, cluster->Render(request));
  EXPECT_EQ(CoveredPixels(result.image), 0);
  EXPECT_EQ(TriangleCount(result), 0);
}

TEST_P(ExactPictureTest, PassedDeadlineAndCancellationEndTheFrame) {
  const Volume volume = Gyroid();
  Datasets datasets(volume, renderer_.get());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(LocalCluster* const cluster,
                                datasets.Get(8, 3, store::Distribution::kRandom));
  const agent::FrameRequest request = RandomRequest(1, volume.geometry.Bounds(), volume.isovalue);
  EXPECT_THAT(cluster->Render(request, base::Cancellation(absl::InfinitePast())),
              testing::StatusIs(absl::StatusCode::kDeadlineExceeded,
                                ::testing::HasSubstr("local agent 2")));
  base::Cancellation cancelled;
  cancelled.Cancel();
  EXPECT_THAT(cluster->Render(request, cancelled), testing::StatusIs(absl::StatusCode::kCancelled));
}

INSTANTIATE_TEST_SUITE_P(BackEnds, ExactPictureTest,
                         ::testing::Values(render::RendererKind::kEgl, render::RendererKind::kCpu),
                         [](const auto& back_end) {
                           return back_end.param == render::RendererKind::kEgl ? "Egl" : "Cpu";
                         });

}  // namespace
}  // namespace isoscope
