// The product's promise (exact_picture_test) on volumes of any kind, type and shape, cut in any
// way, seen from anywhere. A bounded run with seeds that never change; with ISOSCOPE_SOAK_SECONDS
// as long as that, with new seeds each time (scripts/soak.sh).

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <limits>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "core/partition/partitioner.h"
#include "core/render/renderer_factory.h"
#include "core/source/volume_source.h"
#include "tests/support/local_cluster.h"
#include "tests/support/memory_source.h"
#include "tests/support/scenes.h"
#include "tests/support/status_matchers.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/temp_dir.h"

namespace isoscope {
namespace {

constexpr int kRoundCount = 40;  // of a bounded run
constexpr int kViewCount = 4;    // of a round
constexpr absl::Duration kProgressPeriod = absl::Seconds(10);

// Numbers of one round. Thread-compatible.
class Dice {
 public:
  explicit Dice(std::uint64_t seed) : seed_(seed) {}

  std::uint64_t Bits() { return base::RandomBits(seed_, next_++); }
  double Unit() { return base::RandomUnit(seed_, next_++); }
  // In [low, high].
  std::int64_t Whole(std::int64_t low, std::int64_t high) {
    return low + static_cast<std::int64_t>(Bits() % static_cast<std::uint64_t>(high - low + 1));
  }
  bool OneIn(std::int64_t n) { return Whole(1, n) == 1; }
  template <typename T, std::size_t kCount>
  T OneOf(const std::array<T, kCount>& choices) {
    return choices[static_cast<std::size_t>(Whole(0, kCount - 1))];
  }

 private:
  const std::uint64_t seed_;
  std::uint64_t next_ = 0;
};

struct Volume {
  volume::GridGeometry geometry;
  volume::ScalarType type = volume::ScalarType::kUint8;
  std::string samples;
  std::vector<double> isovalues;
};

volume::GridGeometry RandomGeometry(Dice* dice) {
  volume::GridGeometry geometry;
  const auto side = [&] { return dice->OneIn(5) ? dice->Whole(2, 6) : dice->Whole(7, 60); };
  geometry.sample_dims = {side(), side(), side()};
  const auto spacing = [&] { return std::pow(10, 2 * dice->Unit() - 1); };
  geometry.spacing = {spacing(), spacing(), spacing()};
  geometry.origin = {100 * dice->Unit(), -50 * dice->Unit(), 0};
  const double angle = dice->OneIn(3) ? 0 : 6 * dice->Unit();
  const double mirrored = dice->OneIn(3) ? -1 : 1;
  geometry.direction.columns = {math::Vec3d{std::cos(angle), 0, std::sin(angle)},
                                math::Vec3d{0, mirrored, 0},
                                math::Vec3d{-std::sin(angle), 0, std::cos(angle)}};
  return geometry;
}

// Now and then what floating-point volumes hold besides numbers.
template <typename T>
void Spoil(Dice* dice, std::string* samples) {
  constexpr std::array<T, 5> kOdd = {
      std::numeric_limits<T>::quiet_NaN(), std::numeric_limits<T>::infinity(),
      -std::numeric_limits<T>::infinity(), T{-0.0}, std::numeric_limits<T>::denorm_min()};
  const std::size_t count = samples->size() / sizeof(T);
  for (std::size_t i = 0; i < count; i += static_cast<std::size_t>(dice->Whole(1, 200))) {
    const T value = dice->OneOf(kOdd);
    std::memcpy(samples->data() + i * sizeof(T), &value, sizeof(T));
  }
}

Volume RandomVolume(Dice* dice) {
  Volume volume;
  volume.geometry = RandomGeometry(dice);
  volume.type = static_cast<volume::ScalarType>(dice->Whole(1, 8));
  const math::Index3& dims = volume.geometry.sample_dims;
  // Samples on both sides of the isovalues, of any type: within [0, 127].
  if (dice->OneIn(4)) {
    const auto max_value = static_cast<double>(dice->Whole(1, 6));
    volume.samples = testing::SampleNoise(dice->Bits(), dims, volume.type, max_value);
    volume.isovalues = {1, max_value / 2};
  } else {
    const double scale = dice->OneIn(3) ? 3 : 50;  // few levels: ties
    const std::array<testing::Field, 4> fields = {
        testing::GyroidField(1 + 4 * dice->Unit()), testing::MarschnerLobbField(6, 0.25),
        testing::RandomField(dice->Bits(), 30, 2 + 10 * dice->Unit()),
        testing::SphereField(0.2 + dice->Unit())};
    volume.samples = testing::SampleField(dice->OneOf(fields), dims, volume.type, scale, 60);
    volume.isovalues = {60, 60 + scale * (dice->Unit() - 0.5)};
  }
  if (dice->OneIn(3) && volume.type == volume::ScalarType::kFloat32) {
    Spoil<float>(dice, &volume.samples);
  }
  if (dice->OneIn(3) && volume.type == volume::ScalarType::kFloat64) {
    Spoil<double>(dice, &volume.samples);
  }
  return volume;
}

absl::StatusOr<std::unique_ptr<testing::LocalCluster>> Cut(const Volume& volume,
                                                           const math::Index3& block_cells,
                                                           int shard_count, Dice* dice,
                                                           const std::string& directory,
                                                           render::Renderer* renderer) {
  const auto source =
      testing::MakeMemorySource(volume.geometry, volume.type, volume.samples, "soak");
  partition::PartitionOptions options;
  options.output_directory = directory;
  options.block_cells = block_cells;
  options.shard_count = shard_count;
  options.distribution =
      dice->OneIn(2) ? store::Distribution::kRandom : store::Distribution::kGreedy;
  options.compression = dice->OneOf<store::BlockEncoding, 3>(
      {store::BlockEncoding::kRaw, store::BlockEncoding::kLz4, store::BlockEncoding::kZstd});
  options.seed = dice->Bits();
  if (const auto manifest = partition::Partition(*source, options, base::Cancellation());
      !manifest.ok()) {
    return manifest.status();
  }
  constexpr std::array<std::size_t, 4> kCacheSizes = {0, std::size_t{1} << 18, std::size_t{1} << 22,
                                                      testing::LocalCluster::kAmpleCacheBytes};
  return testing::LocalCluster::Open(directory, renderer, static_cast<int>(dice->Whole(1, 3)),
                                     dice->OneOf(kCacheSizes));
}

class SoakTest : public ::testing::TestWithParam<render::RendererKind> {
 protected:
  void SetUp() override {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(renderer_, render::MakeRenderer({.kind = GetParam()}));
  }

  // One volume, cut twice: without culling by one agent, with culling by many, side by side.
  void RunRound(std::uint64_t seed) {
    Dice dice(seed);
    const Volume volume = RandomVolume(&dice);
    const math::Index3& dims = volume.geometry.sample_dims;
    const std::int64_t edge = dice.Whole(1, 20);
    const math::Index3 block_cells =
        dice.OneIn(3) ? math::Index3{dice.Whole(1, 20), dice.Whole(1, 20), dice.Whole(1, 20)}
                      : math::Index3{edge, edge, edge};
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto layout, volume::BlockLayout::Make(dims, block_cells));
    const auto shard_count = static_cast<int>(std::min(layout.block_count(), dice.Whole(1, 16)));
    SCOPED_TRACE(
        absl::StrFormat("seed %d: %d x %d x %d of type %d, blocks of %d x %d x %d, %d shards", seed,
                        dims.x, dims.y, dims.z, static_cast<int>(volume.type), block_cells.x,
                        block_cells.y, block_cells.z, shard_count));
    const testing::TempDir temp;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto one, Cut(volume, block_cells, 1, &dice, temp.Sub("one"), renderer_.get()));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto many, Cut(volume, block_cells, shard_count, &dice,
                                                       temp.Sub("many"), renderer_.get()));
    std::vector<frame::FrameSpec> requests;
    std::vector<server::FrameResult> expected;
    for (int view = 0; view < kViewCount; ++view) {
      frame::FrameSpec request =
          testing::RandomSpec(dice.Bits(), volume.geometry.Bounds(),
                              volume.isovalues[static_cast<std::size_t>(dice.Whole(0, 1))]);
      request.culling = frame::Culling::kNone;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(server::FrameResult result, one->Render(request));
      covered_pixel_count_ += testing::CoveredPixels(result.image);
      request.culling = frame::Culling::kDepth;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult culled, one->Render(request));
      EXPECT_EQ(testing::Compare(culled.image, result.image), testing::Difference())
          << "view " << view << ", one agent";
      culled_view_count_ += testing::TriangleCount(culled) < testing::TriangleCount(result) ? 1 : 0;
      requests.push_back(request);
      expected.push_back(std::move(result));
    }
    const bool side_by_side = dice.OneIn(2);
    std::vector<std::thread> clients;
    for (std::size_t view = 0; view < requests.size(); ++view) {
      const auto check = [&, view] {
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult result,
                                      many->Render(requests[view]));
        EXPECT_EQ(testing::Compare(result.image, expected[view].image), testing::Difference())
            << "view " << view << (side_by_side ? ", beside others" : "");
      };
      if (side_by_side) {
        clients.emplace_back(check);
      } else {
        check();
      }
    }
    for (std::thread& client : clients) {
      client.join();
    }
  }

  std::unique_ptr<render::Renderer> renderer_;
  std::int64_t covered_pixel_count_ = 0;
  std::int64_t culled_view_count_ = 0;
};

TEST_P(SoakTest, CulledPicturesOfAnyNumberOfAgentsAreTheWholePicture) {
  // NOLINTBEGIN(concurrency-mt-unsafe): one thread
  const char* const seconds_text = std::getenv("ISOSCOPE_SOAK_SECONDS");
  const char* const seed_text = std::getenv("ISOSCOPE_SOAK_SEED");
  // NOLINTEND(concurrency-mt-unsafe)
  double seconds = 0;
  ASSERT_TRUE(seconds_text == nullptr || absl::SimpleAtod(seconds_text, &seconds)) << seconds_text;
  std::uint64_t seed =
      seconds > 0 ? static_cast<std::uint64_t>(absl::ToUnixSeconds(absl::Now())) << 16 : 1;
  ASSERT_TRUE(seed_text == nullptr || absl::SimpleAtoi(seed_text, &seed)) << seed_text;
  const absl::Time start = absl::Now();
  absl::Time next_progress = start + kProgressPeriod;
  int round = 0;
  for (; seconds > 0 ? absl::Now() - start < absl::Seconds(seconds) : round < kRoundCount;
       ++round) {
    RunRound(seed + static_cast<std::uint64_t>(round));
    if (HasFailure()) {
      FAIL() << "repeat it with ISOSCOPE_SOAK_SEED=" << seed + static_cast<std::uint64_t>(round);
    }
    if (absl::Now() >= next_progress) {
      std::cerr << "soak_test: " << round + 1 << " volumes\n";
      next_progress = absl::Now() + kProgressPeriod;
    }
  }
  // Defends the test: empty pictures and views where nothing is culled would prove nothing.
  EXPECT_GT(covered_pixel_count_, 500 * round);
  EXPECT_GT(culled_view_count_, round / 4);
}

INSTANTIATE_TEST_SUITE_P(BackEnds, SoakTest,
                         ::testing::Values(render::RendererKind::kEgl, render::RendererKind::kCpu),
                         [](const auto& back_end) {
                           return back_end.param == render::RendererKind::kEgl ? "Egl" : "Cpu";
                         });

}  // namespace
}  // namespace isoscope
