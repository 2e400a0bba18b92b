// The product's promise: the picture with CULLING_DEPTH is that of CULLING_NONE, bit for bit in
// colour, depth and owner, for any number of agents, any distribution and any block size.

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <tuple>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/monotonic_time.h"
#include "core/base/random.h"
#include "core/base/status_macros.h"
#include "core/partition/partitioner.h"
#include "core/render/renderer_factory.h"
#include "core/source/volume_source.h"
#include "tests/support/draws.h"
#include "tests/support/local_cluster.h"
#include "tests/support/memory_source.h"
#include "tests/support/only_volume.h"
#include "tests/support/random_options.h"
#include "tests/support/scenes.h"
#include "tests/support/skips.h"
#include "tests/support/status_matchers.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/temp_dir.h"

namespace isoscope {
namespace {

using image::Rgba8;
using testing::Compare;
using testing::CoveredPixels;
using testing::Crop;
using testing::Difference;
using testing::LocalCluster;
using testing::LocalClusters;
using testing::Picture;
using testing::RandomRegion;
using testing::RandomSpec;
using testing::ThreeSurfaces;
using testing::TriangleCount;

constexpr int kShardCounts[] = {1, 2, 3, 7, 16};
constexpr std::int64_t kBlockEdges[] = {4, 8, 16, 32};
// Views for each generated field, and for the head. Sanitizers look for other bugs: a few do.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr int kFieldViewCount = 6;
constexpr int kHeadViewCount = 1;
#else
constexpr int kFieldViewCount = 20;
constexpr int kHeadViewCount = 4;
#endif
// All, nothing, some samples, and samples with a few segments of meshes.
constexpr std::size_t kCacheSizes[] = {LocalCluster::kAmpleCacheBytes, 0, std::size_t{1} << 19,
                                       std::size_t{4} << 20};
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
          testing::SampleField(testing::GyroidField(3), dims, volume::ScalarType::kUint8, 80, 128),
          128.0};
}

// Whole numbers 0 .. 4 and a whole isovalue: most vertices lie on samples, so sheets touch and
// equal depths are common.
Volume Ties() {
  const math::Index3 dims{26, 29, 31};
  return {"ties", ObliqueGeometry(dims, {1, 1, 1}), volume::ScalarType::kUint16,
          testing::SampleNoise(7, dims, volume::ScalarType::kUint16, 4), 2.0};
}

Volume SmoothRandom() {
  const math::Index3 dims{65, 48, 56};
  return {"smooth_random", ObliqueGeometry(dims, {0.5, 0.75, 2.0}), volume::ScalarType::kFloat32,
          testing::SampleField(testing::RandomField(3, 40, 9.0), dims, volume::ScalarType::kFloat32,
                               1, 0),
          0.05};
}

std::int64_t ReadBytes(const server::FrameResult& result) {
  std::int64_t count = 0;
  for (const frame::AgentStatistics& agent : result.agents) {
    count += agent.read_bytes;
  }
  return count;
}

// Dataset directories of the whole suite, each made once: writing them safely takes longer than
// drawing them.
class DatasetDirectories {
 public:
  absl::StatusOr<std::string> Get(const Volume& volume, std::int64_t edge, int shard_count,
                                  store::Distribution distribution) {
    std::string& directory = directories_[{volume.name, edge, shard_count, distribution}];
    if (directory.empty()) {
      const auto source =
          testing::MakeMemorySource(volume.geometry, volume.type, volume.samples, volume.name);
      partition::PartitionOptions options;
      options.output_directory = temp_.Sub("d" + std::to_string(directories_.size()));
      options.shard_count = shard_count;
      options.block_cells = {edge, edge, edge};
      options.distribution = distribution;
      absl::StatusOr<store::Manifest> manifest =
          partition::Partition(*source, options, base::Cancellation());
      if (!manifest.ok()) {
        return manifest.status();
      }
      directory = options.output_directory;
    }
    return directory;
  }

 private:
  testing::TempDir temp_;
  std::map<std::tuple<std::string, std::int64_t, int, store::Distribution>, std::string>
      directories_;
};

// Clusters of one back end on the datasets of a volume, each opened once.
class Datasets {
 public:
  Datasets(const Volume& volume, DatasetDirectories* directories, render::Renderer* renderer)
      : volume_(volume),
        directories_(directories),
        clusters_(renderer, testing::DrawSeed(volume.name)) {}

  // Wakes the cluster, with threads and limits at random. It sleeps at the next call.
  absl::StatusOr<LocalCluster*> Get(std::int64_t edge, int shard_count,
                                    store::Distribution distribution) {
    const absl::StatusOr<std::string> directory =
        directories_->Get(volume_, edge, shard_count, distribution);
    return directory.ok() ? clusters_.Wake(*directory) : directory.status();
  }

  [[nodiscard]] volume::BlockLayout Layout(std::int64_t edge) const {
    return *volume::BlockLayout::Make(volume_.geometry.sample_dims, {edge, edge, edge});
  }
  [[nodiscard]] std::int64_t BlockCount(std::int64_t edge) const {
    return Layout(edge).block_count();
  }

 private:
  const Volume& volume_;
  DatasetDirectories* const directories_;
  LocalClusters clusters_;
};

class ExactPictureTest : public ::testing::TestWithParam<render::RendererKind> {
 protected:
  void SetUp() override {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        renderer_, testing::MakeSharedRenderer(GetParam(), testing::DrawSeed("renderer")));
    if (directories_ == nullptr) {
      directories_ = std::make_unique<DatasetDirectories>();
    }
  }
  static void TearDownTestSuite() { directories_.reset(); }

  // Renders `camera_count` random views; for each, every shard count against CULLING_NONE of one
  // shard.
  void CheckRandomViews(const Volume& volume, int camera_count, std::uint64_t first_seed) {
    Datasets datasets(volume, directories_.get(), renderer_.get());
    std::int64_t covered_pixel_count = 0;
    std::int64_t culled_view_count = 0;
    for (int i = 0; i < camera_count; ++i) {
      const std::uint64_t seed = first_seed + static_cast<std::uint64_t>(i);
      const std::int64_t edge = kBlockEdges[i % 4];
      // Volumes differ in it: so each edge and shard count has both.
      const auto distribution_of = [&](int shard_count) {
        return (static_cast<std::uint64_t>(i % 4 + shard_count) + first_seed / 1000) % 2 == 0
                   ? store::Distribution::kRandom
                   : store::Distribution::kGreedy;
      };
      frame::FrameSpec request = RandomSpec(seed, volume.geometry.Bounds(), volume.isovalue);
      SCOPED_TRACE(volume.name + ", seed " + std::to_string(seed) + ", block edge " +
                   std::to_string(edge));

      ISOSCOPE_ASSERT_OK_AND_ASSIGN(LocalCluster* const one,
                                    datasets.Get(edge, 1, distribution_of(1)));
      request.culling = frame::Culling::kNone;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult reference, one->Render(request));
      covered_pixel_count += CoveredPixels(reference.image);

      request.culling = frame::Culling::kDepth;
      std::int64_t triangle_count_of_one = -1;
      for (const int shard_count : kShardCounts) {
        if (shard_count > datasets.BlockCount(edge)) {
          continue;
        }
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(
            LocalCluster* const cluster,
            datasets.Get(edge, shard_count, distribution_of(shard_count)));
        if (shard_count == 7) {
          cluster->LoseAgents();
        }
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult result, cluster->Render(request));
        const Difference difference = Compare(reference.image, result.image);
        EXPECT_EQ(difference, Difference()) << shard_count << " shards, " << cluster->limits();
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

  static void ExpectSame(const server::FrameResult& result, const server::FrameResult& reference) {
    const Difference difference = Compare(reference.image, result.image);
    EXPECT_EQ(difference.colors, 0);
    EXPECT_EQ(difference.depths, 0);
    EXPECT_EQ(difference.owners, 0);
  }

  std::unique_ptr<render::Renderer> renderer_;  // null: clusters make a CPU renderer
  inline static std::unique_ptr<DatasetDirectories> directories_;
};

// Properties of a single back end.
class CpuExactPictureTest : public ExactPictureTest {};

TEST_P(ExactPictureTest, CullingByDepthChangesNoPixelOfGeneratedFields) {
  CheckRandomViews(Gyroid(), kFieldViewCount, 1000);
  CheckRandomViews(Ties(), kFieldViewCount, 2000);
  CheckRandomViews(SmoothRandom(), kFieldViewCount, 3000);
}

TEST_P(ExactPictureTest, CullingByDepthChangesNoPixelOfTheMriHead) {
  if (!std::filesystem::exists(kHeadPath)) {
    ISOSCOPE_SKIP("head", absl::StrCat(kHeadPath, " is absent: install Debian's mricron-data"));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<source::VolumeSource> source,
                                source::OpenVolumeFile(kHeadPath));
  Volume head{"ch2", source->info().geometry, source->info().type, "", 60.0};
  head.samples.resize(static_cast<std::size_t>(math::Volume(head.geometry.sample_dims)) *
                      volume::SizeOf(head.type));
  ISOSCOPE_ASSERT_OK(source->ReadSlab(0, head.geometry.sample_dims.z, head.samples.data()));
  CheckRandomViews(head, kHeadViewCount, 9000);
}

TEST_P(ExactPictureTest, ARegionIsTheCropOfTheWholeCulledAndNotForAnyNumberOfAgents) {
  std::uint64_t seed = 7000;
  std::int64_t covered_pixel_count = 0;
  for (const Volume& volume : {Gyroid(), Ties(), SmoothRandom()}) {
    Datasets datasets(volume, directories_.get(), renderer_.get());
    for (int i = 0; i < kFieldViewCount; ++i, ++seed) {
      SCOPED_TRACE(volume.name + ", seed " + std::to_string(seed));
      frame::FrameSpec request = RandomSpec(seed, volume.geometry.Bounds(), volume.isovalue);
      const std::int64_t edge = kBlockEdges[i % 3];  // 3 shards need more than one block
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(LocalCluster* const one,
                                    datasets.Get(edge, 1, store::Distribution::kRandom));
      request.culling = frame::Culling::kNone;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult whole, one->Render(request));
      for (int k = 0; k < 3; ++k) {
        // The last one is a single pixel.
        request.region = RandomRegion(10 * seed + static_cast<std::uint64_t>(k), request.viewport);
        if (k == 2) {
          request.region->width_px = 1;
          request.region->height_px = 1;
        }
        SCOPED_TRACE(::testing::Message()
                     << "region " << request.region->width_px << " x " << request.region->height_px
                     << " at " << request.region->x << ", " << request.region->y << " of "
                     << request.viewport.width_px << " x " << request.viewport.height_px);
        const image::FrameImage expected = Crop(whole.image, *request.region);
        covered_pixel_count += CoveredPixels(expected);
        for (const int shard_count : {1, 3}) {
          ISOSCOPE_ASSERT_OK_AND_ASSIGN(
              LocalCluster* const cluster,
              datasets.Get(edge, shard_count, store::Distribution::kRandom));
          for (const frame::Culling culling : {frame::Culling::kDepth, frame::Culling::kNone}) {
            request.culling = culling;
            ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult part, cluster->Render(request));
            EXPECT_EQ(Compare(expected, part.image), Difference())
                << shard_count << " shards, " << cluster->limits();
          }
        }
        if (HasFailure()) {
          return;
        }
      }
    }
  }
  EXPECT_GT(covered_pixel_count, 3 * kFieldViewCount * 500);
}

// Above 16384 pixels a side the whole can't be drawn. Overlapping regions must agree instead.
TEST_P(ExactPictureTest, OverlappingRegionsOfAViewportThatNobodyCanDrawAgree) {
  const Volume volume = Gyroid();
  Datasets datasets(volume, directories_.get(), renderer_.get());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(LocalCluster* const cluster,
                                datasets.Get(8, 3, store::Distribution::kRandom));
  frame::FrameSpec request;
  request.surfaces = {{.rule = {.isovalue = volume.isovalue}, .appearance = {}}};
  request.camera = view::MakeDefaultCamera(volume.geometry.Bounds());
  request.viewport = {65536, 50000};
  request.region = {32000, 24000, 400, 300};
  if (GetParam() != render::RendererKind::kCpu) {
    const absl::Status status = cluster->Render(request).status();
    EXPECT_THAT(status, testing::StatusIs(absl::StatusCode::kInvalidArgument));
    EXPECT_THAT(std::string(status.message()), ::testing::HasSubstr("--renderer cpu"));
    return;
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult large, cluster->Render(request));
  EXPECT_GT(CoveredPixels(large.image), 1000);
  for (const view::Region inner :
       {view::Region{32000, 24000, 57, 300}, view::Region{32130, 24111, 200, 99},
        view::Region{32399, 24299, 1, 1}}) {
    request.region = inner;
    for (const frame::Culling culling : {frame::Culling::kDepth, frame::Culling::kNone}) {
      request.culling = culling;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult part, cluster->Render(request));
      const view::Region shifted{inner.x - 32000, inner.y - 24000, inner.width_px, inner.height_px};
      EXPECT_EQ(Compare(Crop(large.image, shifted), part.image), Difference());
    }
  }
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
  Datasets datasets(volume, directories_.get(), renderer_.get());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(LocalCluster* const cluster,
                                datasets.Get(4, 3, store::Distribution::kRandom));
  frame::FrameSpec request;
  request.surfaces.resize(1);
  request.surfaces[0].rule.isovalue = volume.isovalue;
  request.viewport = {128, 128};
  request.camera = view::MakeDefaultCamera(volume.geometry.Bounds());
  view::Azimuth(0.3, &*request.camera);
  view::Elevation(0.2, &*request.camera);
  view::OrthogonalizeUp(&*request.camera);

  request.culling = frame::Culling::kNone;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult reference, cluster->Render(request));
  request.culling = frame::Culling::kMask;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult masked, cluster->Render(request));
  request.culling = frame::Culling::kDepth;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult exact, cluster->Render(request));

  EXPECT_GT(Compare(reference.image, masked.image).depths, 0)
      << "the field no longer shows why the mask must carry depth";
  const Difference difference = Compare(reference.image, exact.image);
  EXPECT_EQ(difference.colors, 0);
  EXPECT_EQ(difference.depths, 0);
  EXPECT_EQ(difference.owners, 0);
}

// The caches of agents and coordinator keep everything, nothing, or a part that changes all the
// time. Views and levels alternate.
TEST_P(ExactPictureTest, NoPixelAndNoTriangleDependsOnWhatWasKept) {
  const Volume volume = Gyroid();
  Datasets datasets(volume, directories_.get(), renderer_.get());
  struct Step {
    std::uint64_t seed;
    double isovalue;
  };
  const std::vector<Step> steps = {{1, 128}, {1, 128}, {2, 128}, {1, 150}, {2, 150},
                                   {1, 128}, {2, 150}, {2, 128}, {1, 150}};
  constexpr frame::Culling kCullings[] = {frame::Culling::kNone, frame::Culling::kMask,
                                          frame::Culling::kDepth};
  std::int64_t covered_pixel_count = 0;
  std::map<std::tuple<std::size_t, frame::Culling>, std::int64_t> triangle_counts;
  for (const int shard_count : kShardCounts) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(LocalCluster* const cluster,
                                  datasets.Get(8, shard_count, store::Distribution::kRandom));
    // Without any memory, step by step.
    std::vector<server::FrameResult> expected;
    const auto request_of = [&](const Step& step, frame::Culling culling) {
      frame::FrameSpec request = RandomSpec(step.seed, volume.geometry.Bounds(), step.isovalue);
      request.culling = culling;
      return request;
    };
    for (const frame::Culling culling : kCullings) {
      for (const Step& step : steps) {
        cluster->ForgetAll(0);
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(server::FrameResult result,
                                      cluster->Render(request_of(step, culling)));
        EXPECT_GT(ReadBytes(result), 0);
        covered_pixel_count += CoveredPixels(result.image);
        // Nor does it depend on the number of shards.
        const auto [count, is_new] =
            triangle_counts.try_emplace({expected.size(), culling}, TriangleCount(result));
        EXPECT_EQ(TriangleCount(result), count->second) << shard_count << " shards";
        expected.push_back(std::move(result));
      }
    }
    for (const std::size_t cache_bytes : kCacheSizes) {
      cluster->ForgetAll(cache_bytes);
      std::size_t next = 0;
      for (const frame::Culling culling : kCullings) {
        for (std::size_t i = 0; i < steps.size(); ++i, ++next) {
          SCOPED_TRACE(::testing::Message()
                       << shard_count << " shards, cache of " << cache_bytes << " bytes, culling "
                       << static_cast<int>(culling) << ", step " << i);
          ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult result,
                                        cluster->Render(request_of(steps[i], culling)));
          ExpectSame(result, expected[next]);
          EXPECT_EQ(TriangleCount(result), TriangleCount(expected[next]));
          EXPECT_LE(cluster->cache().size_bytes(), cache_bytes);
          if (cache_bytes == LocalCluster::kAmpleCacheBytes && next > 3) {
            EXPECT_EQ(ReadBytes(result), 0) << "all of it was read before, and fits";
          }
          if (HasFailure()) {
            return;
          }
        }
      }
    }
  }
  EXPECT_GT(covered_pixel_count, 100'000);
}

TEST_P(ExactPictureTest, FramesSideBySideOnOneCacheAreTheirOwn) {
  const Volume volume = Gyroid();
  Datasets datasets(volume, directories_.get(), renderer_.get());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(LocalCluster* const cluster,
                                datasets.Get(8, 3, store::Distribution::kRandom));
  std::vector<frame::FrameSpec> requests;
  std::vector<server::FrameResult> expected;
  for (std::uint64_t i = 0; i < 4; ++i) {
    requests.push_back(RandomSpec(1 + i / 2, volume.geometry.Bounds(), i % 2 == 0 ? 128 : 150));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(server::FrameResult result, cluster->Render(requests.back()));
    expected.push_back(std::move(result));
  }
  for (const std::size_t cache_bytes : kCacheSizes) {
    cluster->ForgetAll(cache_bytes);
    std::vector<std::thread> clients;
    for (std::size_t i = 0; i < requests.size(); ++i) {
      clients.emplace_back([&, i] {
        for (int frame = 0; frame < 4; ++frame) {
          ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult result,
                                        cluster->Render(requests[i]));
          ExpectSame(result, expected[i]);
        }
      });
    }
    for (std::thread& client : clients) {
      client.join();
    }
  }
}

TEST_P(ExactPictureTest, IsovalueOutsideTheDataIsAnEmptyPicture) {
  const Volume volume = Gyroid();
  Datasets datasets(volume, directories_.get(), renderer_.get());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(LocalCluster* const cluster,
                                datasets.Get(8, 2, store::Distribution::kRandom));
  frame::FrameSpec request = RandomSpec(1, volume.geometry.Bounds(), 1e6);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult result, cluster->Render(request));
  EXPECT_EQ(CoveredPixels(result.image), 0);
  EXPECT_EQ(TriangleCount(result), 0);
}

TEST_P(ExactPictureTest, PassedDeadlineAndCancellationEndTheFrame) {
  const Volume volume = Gyroid();
  Datasets datasets(volume, directories_.get(), renderer_.get());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(LocalCluster* const cluster,
                                datasets.Get(8, 3, store::Distribution::kRandom));
  const frame::FrameSpec request = RandomSpec(1, volume.geometry.Bounds(), volume.isovalue);
  EXPECT_THAT(cluster->Render(request, base::Cancellation(base::MonotonicTime::InfinitePast())),
              testing::StatusIs(absl::StatusCode::kDeadlineExceeded,
                                ::testing::HasSubstr("local agent 2")));
  base::Cancellation cancelled;
  cancelled.Cancel();
  EXPECT_THAT(cluster->Render(request, cancelled), testing::StatusIs(absl::StatusCode::kCancelled));
}

TEST_P(ExactPictureTest, CullingByDepthChangesNoPixelOfSeveralSurfaces) {
  for (const auto& [volume, step] : {std::pair(Gyroid(), 15.0), std::pair(Ties(), 1.0)}) {
    Datasets datasets(volume, directories_.get(), renderer_.get());
    std::set<std::uint32_t> surfaces_seen;
    for (std::uint64_t seed = 1; seed <= 12; ++seed) {
      SCOPED_TRACE(volume.name + ", seed " + std::to_string(seed));
      frame::FrameSpec spec = RandomSpec(seed, volume.geometry.Bounds(), volume.isovalue);
      spec.surfaces = ThreeSurfaces(volume.isovalue, step);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(LocalCluster* const one,
                                    datasets.Get(8, 1, store::Distribution::kRandom));
      spec.culling = frame::Culling::kNone;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult reference, one->Render(spec));
      const image::FragmentOrder order{.block_count =
                                           static_cast<std::uint32_t>(datasets.BlockCount(8))};
      for (const std::uint64_t key : reference.image.keys) {
        if (key != image::kBackgroundKey) {
          surfaces_seen.insert(order.SurfaceOf(image::OwnerOf(key)));
        }
      }
      spec.culling = frame::Culling::kDepth;
      for (const int shard_count : {1, 3}) {
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(LocalCluster* const cluster,
                                      datasets.Get(8, shard_count, store::Distribution::kRandom));
        SCOPED_TRACE(::testing::Message() << shard_count << " shards, " << cluster->limits());
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult result, cluster->Render(spec));
        ExpectSame(result, reference);
      }
    }
    // Two surfaces have one level: the earlier one is visible everywhere.
    EXPECT_EQ(surfaces_seen, (std::set<std::uint32_t>{0, 1}));
  }
}

TEST_P(ExactPictureTest, CullingByDepthChangesNoPixelOfARandomRequest) {
  const bool is_egl = GetParam() == render::RendererKind::kEgl;
  const std::uint64_t view_count = static_cast<std::uint64_t>(kFieldViewCount) * (is_egl ? 1 : 5);
  for (const auto& [volume, step] : {std::pair(Gyroid(), 15.0), std::pair(Ties(), 1.0)}) {
    Datasets datasets(volume, directories_.get(), renderer_.get());
    std::int64_t covered_pixel_count = 0;
    std::int64_t layer_pixel_count = 0;
    std::int64_t truncated_pixel_count = 0;
    std::int64_t smaller_count = 0;
    for (std::uint64_t seed = 1; seed <= view_count; ++seed) {
      SCOPED_TRACE(volume.name + ", seed " + std::to_string(seed));
      frame::FrameSpec spec = RandomSpec(seed, volume.geometry.Bounds(), volume.isovalue);
      if (seed % 2 == 0) {
        spec.surfaces = ThreeSurfaces(volume.isovalue, step);
      }
      if (seed % 4 > 1) {
        testing::MakeRandomlyTranslucent(seed, &spec);
      }
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(LocalCluster* const one,
                                    datasets.Get(8, 1, store::Distribution::kRandom));
      spec.culling = frame::Culling::kNone;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult whole, one->Render(spec));
      spec.clip = testing::RandomClip(seed, volume.geometry.Bounds());
      testing::AddRandomCaps(seed, &spec);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(server::FrameResult reference, one->Render(spec));
      covered_pixel_count += CoveredPixels(reference.image);
      smaller_count += TriangleCount(reference) < TriangleCount(whole) ? 1 : 0;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(
          const Picture expected_picture,
          testing::PictureOf(std::move(reference), spec, datasets.Layout(8), volume.geometry));
      layer_pixel_count += expected_picture.layer_pixel_count;
      truncated_pixel_count += expected_picture.truncated_pixel_count;

      spec.culling = frame::Culling::kDepth;
      image::FrameImage expected = expected_picture.image;
      if (seed % 3 == 0) {
        spec.region = RandomRegion(seed, spec.viewport);
        expected = Crop(expected_picture.image, *spec.region);
      }
      for (const auto& [edge, shard_count] : {std::pair(8, 1), std::pair(8, 3), std::pair(5, 2)}) {
        if (is_egl && edge != 8) {
          continue;  // OpenGL's pictures depend on how the volume is cut
        }
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(
            LocalCluster* const cluster,
            datasets.Get(edge, shard_count, store::Distribution::kRandom));
        if (shard_count == 3) {
          cluster->LoseAgents();
        }
        SCOPED_TRACE(::testing::Message() << "block edge " << edge << ", " << shard_count
                                          << " shards, " << cluster->limits());
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(server::FrameResult result, cluster->Render(spec));
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(
            const Picture picture,
            testing::PictureOf(std::move(result), spec, datasets.Layout(edge), volume.geometry));
        const Difference difference = Compare(expected, picture.image);
        EXPECT_EQ(difference.colors, 0);
        EXPECT_EQ(difference.depths, 0);
        if (!spec.region) {
          EXPECT_EQ(picture.truncated_pixel_count, expected_picture.truncated_pixel_count);
        }
      }
      if (HasFailure()) {
        return;
      }
    }
    EXPECT_GT(covered_pixel_count, static_cast<std::int64_t>(view_count) * 200);
    EXPECT_GE(smaller_count, static_cast<std::int64_t>(view_count) / 2)
        << "blocks outside the clip region are drawn";
    EXPECT_GT(layer_pixel_count, static_cast<std::int64_t>(view_count) * 100);
    EXPECT_GT(truncated_pixel_count, 0);
  }
}

// Colours that the coordinator computes from normals: with lights, and of positions and normals.
TEST_P(ExactPictureTest, NeitherCullingNorAgentsShowInLightsAndColorMaps) {
  const bool is_egl = GetParam() == render::RendererKind::kEgl;
  const std::uint64_t view_count = static_cast<std::uint64_t>(kFieldViewCount) * (is_egl ? 1 : 3);
  for (const auto& [volume, step] : {std::pair(Gyroid(), 15.0), std::pair(Ties(), 1.0)}) {
    Datasets datasets(volume, directories_.get(), renderer_.get());
    std::set<std::uint32_t> colors_seen;
    testing::Limits limits;
    for (std::uint64_t seed = 1; seed <= view_count; ++seed) {
      SCOPED_TRACE(volume.name + ", seed " + std::to_string(seed));
      frame::FrameSpec spec = RandomSpec(seed, volume.geometry.Bounds(), volume.isovalue);
      if (seed % 2 == 0) {
        spec.surfaces = ThreeSurfaces(volume.isovalue, step);
      }
      testing::AddRandomLook(seed, &spec);
      if (seed % 4 == 0) {
        spec.clip = testing::RandomClip(seed, volume.geometry.Bounds());
        testing::AddRandomCaps(seed, &spec);
      }
      const auto shaded = [&](std::int64_t edge,
                              int shard_count) -> absl::StatusOr<image::FrameImage> {
        ISOSCOPE_ASSIGN_OR_RETURN(LocalCluster* const cluster,
                                  datasets.Get(edge, shard_count, store::Distribution::kRandom));
        limits = cluster->limits();
        ISOSCOPE_ASSIGN_OR_RETURN(server::FrameResult result, cluster->Render(spec));
        ISOSCOPE_ASSIGN_OR_RETURN(
            Picture picture,
            testing::PictureOf(std::move(result), spec, datasets.Layout(edge), volume.geometry));
        return std::move(picture.image);
      };
      spec.culling = frame::Culling::kNone;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(image::FrameImage expected, shaded(8, 1));
      for (const Rgba8& color : expected.colors) {
        colors_seen.insert(image::PackedColor(color));
      }
      spec.culling = frame::Culling::kDepth;
      if (seed % 3 == 0) {
        spec.region = RandomRegion(seed, spec.viewport);
        expected = Crop(expected, *spec.region);
      }
      for (const auto& [edge, shard_count] :
           {std::pair(8, 1), std::pair(8, 2), std::pair(8, 3), std::pair(5, 2)}) {
        if (is_egl && edge != 8) {
          continue;  // OpenGL's pictures depend on how the volume is cut
        }
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage image, shaded(edge, shard_count));
        SCOPED_TRACE(::testing::Message()
                     << "block edge " << edge << ", " << shard_count << " shards, " << limits);
        const Difference difference = Compare(expected, image);
        EXPECT_EQ(difference.colors, 0);
        EXPECT_EQ(difference.depths, 0);
      }
      if (HasFailure()) {
        return;
      }
    }
    EXPECT_GT(colors_seen.size(), 2000U) << "the pictures show no lights";
  }
}

// Other fields on the grid of a volume: smooth; with many equal values; with NaN and infinities.
std::vector<Volume> FieldsOn(const Volume& volume) {
  const math::Index3& dims = volume.geometry.sample_dims;
  std::vector<Volume> fields = {
      {"smooth", volume.geometry, volume::ScalarType::kFloat32,
       testing::SampleField(testing::RandomField(11, 30, 7.0), dims, volume::ScalarType::kFloat32,
                            6, 9),
       0},
      {"steps", volume.geometry, volume::ScalarType::kUint16,
       testing::SampleNoise(12, dims, volume::ScalarType::kUint16, 20), 0},
      {"holes", volume.geometry, volume::ScalarType::kFloat64,
       testing::SampleField(testing::RandomField(13, 30, 5.0), dims, volume::ScalarType::kFloat64,
                            6, 9),
       0}};
  std::string& holes = fields.back().samples;
  for (std::size_t i = 0; i < holes.size() / sizeof(double); ++i) {
    const double draw = base::RandomUnit(14, i);
    if (draw < 0.03) {
      const double value = draw < 0.01   ? std::numeric_limits<double>::quiet_NaN()
                           : draw < 0.02 ? std::numeric_limits<double>::infinity()
                                         : -1e308;
      base::StoreLittleEndian(value, holes.data() + i * sizeof(double));
    }
  }
  return fields;
}

// Surfaces that show the samples of other volumes: opaque, translucent, with caps, from any cache.
TEST_P(ExactPictureTest, NeitherCullingNorAgentsShowInTheColorsOfAnotherField) {
  const bool is_egl = GetParam() == render::RendererKind::kEgl;
  const std::uint64_t view_count = static_cast<std::uint64_t>(kFieldViewCount) * (is_egl ? 1 : 4);
  for (const auto& [volume, step] : {std::pair(Gyroid(), 15.0), std::pair(Ties(), 1.0)}) {
    Datasets datasets(volume, directories_.get(), renderer_.get());
    const std::vector<Volume> fields = FieldsOn(volume);
    std::set<std::uint32_t> colors_seen;
    std::int64_t layer_pixel_count = 0;
    std::size_t missing_count = 0;  // surfaces that show missing values
    std::uint64_t draw = 0;
    for (std::uint64_t seed = 1; seed <= view_count; ++seed) {
      SCOPED_TRACE(volume.name + ", seed " + std::to_string(seed));
      frame::FrameSpec spec = RandomSpec(seed, volume.geometry.Bounds(), volume.isovalue);
      if (seed % 2 == 0) {
        spec.surfaces = ThreeSurfaces(volume.isovalue, step);
      }
      if (seed % 5 == 0) {
        testing::MakeRandomlyTranslucent(seed, &spec);
      }
      testing::AddRandomLook(seed, &spec);
      testing::ShowRandomFields(seed, {"smooth", "steps", "holes"}, &spec);
      if (seed % 3 == 0) {
        spec.clip = testing::RandomClip(seed, volume.geometry.Bounds());
        testing::AddRandomCaps(seed, &spec);
      }
      testing::Limits limits;
      const auto render = [&](std::int64_t edge, int shard_count) -> absl::StatusOr<Picture> {
        constexpr store::Distribution kRandom = store::Distribution::kRandom;
        ISOSCOPE_ASSIGN_OR_RETURN(LocalCluster* const cluster,
                                  datasets.Get(edge, shard_count, kRandom));
        for (Volume field : fields) {
          const std::string name = std::exchange(field.name, volume.name + " " + field.name);
          ISOSCOPE_ASSIGN_OR_RETURN(const std::string directory,
                                    directories_->Get(field, edge, shard_count, kRandom));
          ISOSCOPE_RETURN_IF_ERROR(cluster->AddField(name, directory));
        }
        if (base::RandomUnit(15, ++draw) < 0.3) {
          cluster->ForgetAll(kCacheSizes[draw % std::size(kCacheSizes)]);
        }
        if (shard_count == 2 && edge == 8) {
          cluster->LoseAgents();
        }
        limits = cluster->limits();
        ISOSCOPE_ASSIGN_OR_RETURN(server::FrameResult result, cluster->Render(spec));
        return testing::PictureOf(std::move(result), spec, datasets.Layout(edge), volume.geometry);
      };
      spec.culling = frame::Culling::kNone;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Picture whole, render(8, 1));
      layer_pixel_count += whole.layer_pixel_count;
      missing_count += whole.contents.without_values.count();
      for (const Rgba8& color : whole.image.colors) {
        colors_seen.insert(image::PackedColor(color));
      }
      image::FrameImage expected = whole.image;
      spec.culling = frame::Culling::kDepth;
      if (seed % 4 == 0) {
        spec.region = RandomRegion(seed, spec.viewport);
        expected = Crop(expected, *spec.region);
      }
      for (const auto& [edge, shard_count] :
           {std::pair(8, 1), std::pair(8, 2), std::pair(8, 3), std::pair(5, 2), std::pair(13, 1)}) {
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Picture picture, render(edge, shard_count));
        SCOPED_TRACE(::testing::Message()
                     << "block edge " << edge << ", " << shard_count << " shards, " << limits);
        const Difference difference = Compare(expected, picture.image);
        EXPECT_EQ(difference.colors, 0);
        EXPECT_EQ(difference.depths, 0);
        if (!spec.region.has_value()) {
          EXPECT_EQ(picture.contents, whole.contents);
        }
      }
      if (HasFailure()) {
        return;
      }
    }
    EXPECT_GT(missing_count, view_count / 8) << "the pictures show no missing values";
    EXPECT_GT(colors_seen.size(), 2000U) << "the pictures show no fields";
    EXPECT_GT(layer_pixel_count, static_cast<std::int64_t>(view_count) * 50);
  }
}

// docs/numerics.md, the second promise.
TEST_P(CpuExactPictureTest, BlocksDoNotShowInDepthAndColor) {
  std::int64_t moved_owner_count = 0;
  for (const auto& [volume, step] :
       {std::pair(Gyroid(), 15.0), std::pair(Ties(), 1.0), std::pair(SmoothRandom(), 0.2)}) {
    Datasets datasets(volume, directories_.get(), renderer_.get());
    for (std::uint64_t seed = 1; seed <= 40; ++seed) {
      frame::FrameSpec spec = RandomSpec(seed, volume.geometry.Bounds(), volume.isovalue);
      if (seed % 4 == 0) {
        spec.surfaces = ThreeSurfaces(volume.isovalue, step);
      }
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(LocalCluster* const one,
                                    datasets.Get(8, 1, store::Distribution::kRandom));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult reference, one->Render(spec));
      for (const auto& [edge, shard_count] : {std::pair(4, 3), std::pair(7, 1), std::pair(16, 3)}) {
        SCOPED_TRACE(absl::StrCat(volume.name, ", seed ", seed, ", block edge ", edge));
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(
            LocalCluster* const cluster,
            datasets.Get(edge, shard_count, store::Distribution::kRandom));
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult result, cluster->Render(spec));
        const Difference difference = Compare(reference.image, result.image);
        EXPECT_EQ(difference.colors, 0) << cluster->limits();
        EXPECT_EQ(difference.depths, 0) << cluster->limits();
        moved_owner_count += difference.owners;
      }
      if (HasFailure()) {
        return;
      }
    }
  }
  EXPECT_GT(moved_owner_count, 0) << "the volumes were cut alike";
}

// A request at which two triangles of different blocks have one depth and different colours.
TEST_P(CpuExactPictureTest, AKnownTieDoesNotShowHowTheVolumeWasCut) {
  const char* const data = std::getenv("ISOSCOPE_DATA_DIR");
  const std::filesystem::path path =
      std::filesystem::path(data != nullptr ? data : ISOSCOPE_DEFAULT_DATA_DIR).parent_path() /
      "reference/tie/field.nrrd";
  if (!std::filesystem::exists(path)) {
    ISOSCOPE_SKIP("data", absl::StrCat(path.string(), " is absent"));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<source::VolumeSource> source,
                                source::OpenVolumeFile(path.string()));
  Volume volume{"tie", source->info().geometry, source->info().type, "", 30000.0};
  volume.samples.resize(static_cast<std::size_t>(math::Volume(volume.geometry.sample_dims)) *
                        volume::SizeOf(volume.type));
  ISOSCOPE_ASSERT_OK(source->ReadSlab(0, volume.geometry.sample_dims.z, volume.samples.data()));
  Datasets datasets(volume, directories_.get(), renderer_.get());
  frame::FrameSpec spec;
  spec.surfaces = {{.rule = {.isovalue = volume.isovalue}, .appearance = {}}};
  view::Camera& camera = spec.camera.emplace();
  camera.eye = {223.47368606080332, -75.87608601822026, 280.17718837759014};
  camera.target = {99.24046611953719, 72.68238887999725, 87.94743351561094};
  camera.up = {-1.1996886540292642, 0.2111996297149444, 0.6095377233891343};
  camera.projection = view::Projection::kOrthographic;
  camera.view_height = 190.5;
  spec.viewport = {.width_px = 475, .height_px = 317};
  spec.ray_seed = 583629086;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(LocalCluster* const one,
                                datasets.Get(8, 1, store::Distribution::kRandom));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult reference, one->Render(spec));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(LocalCluster* const many,
                                datasets.Get(7, 16, store::Distribution::kRandom));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult result, many->Render(spec));
  const Difference difference = Compare(reference.image, result.image);
  EXPECT_EQ(difference.colors, 0);
  EXPECT_EQ(difference.depths, 0);
  // The two fragments of equal depth: the smaller colour shows, however the volume is cut.
  EXPECT_EQ(reference.image.colors[reference.image.IndexOf(219, 262)],
            (image::Rgba8{47, 44, 40, 255}));
}

INSTANTIATE_TEST_SUITE_P(BackEnds, ExactPictureTest,
                         ::testing::Values(render::RendererKind::kEgl, render::RendererKind::kCpu),
                         [](const auto& back_end) {
                           return back_end.param == render::RendererKind::kEgl ? "Egl" : "Cpu";
                         });
// OpenGL's ties go to the lower block.
INSTANTIATE_TEST_SUITE_P(Cpu, CpuExactPictureTest, ::testing::Values(render::RendererKind::kCpu),
                         [](const auto& /*back_end*/) { return "Cpu"; });

}  // namespace
}  // namespace isoscope
