// The product's promise (exact_picture_test) on volumes and series of any kind, type and shape, and
// on their levels, cut in any way, seen from anywhere, with any number of threads and any memory
// limit; and exact depths between their bounds. Bounded runs with seeds that never change.
// scripts/soak.sh makes them long, with new seeds each time:
//
//   ISOSCOPE_SOAK_SECONDS  how long large volumes are drawn
//   ISOSCOPE_SOAK_FRAMES   how many small frames are compared, at least
//   ISOSCOPE_SOAK_SEED     of the first volume; each one after it has the next

#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/time/time.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/frame/drawn_window.h"
#include "core/io/file.h"
#include "core/partition/level_plan.h"
#include "core/partition/partitioner.h"
#include "core/partition/series_partitioner.h"
#include "core/picture/color_map.h"
#include "core/picture/deferred_shading.h"
#include "core/picture/layer_blending.h"
#include "core/render/renderer_factory.h"
#include "core/source/adapt/magnitude_source.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"
#include "core/store/series_manifest.h"
#include "core/view/level_choice.h"
#include "core/view/view.h"
#include "core/visibility/depth_bounds.h"
#include "core/volume/volume_level.h"
#include "partition-agent/supply/block_bounds.h"
#include "server/picture/picture_finish.h"
#include "tests/support/draws.h"
#include "tests/support/level_files.h"
#include "tests/support/local_cluster.h"
#include "tests/support/memory_source.h"
#include "tests/support/only_arena.h"
#include "tests/support/random_options.h"
#include "tests/support/scenes.h"
#include "tests/support/status_matchers.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/temp_dir.h"

namespace isoscope {
namespace {

using testing::Dice;
using testing::LocalCluster;

constexpr int kRoundCount = 40;  // of a bounded run
constexpr int kViewCount = 4;    // of a round
// Counts of a round of small frames: frames, partitionings of the volume, and new memory limits for
// the cluster of a partitioning.
constexpr int kSmallFrameCount = 8;
constexpr int kCutCount = 3;
constexpr int kWakeCount = 2;
// The same of a round of series, whose volumes take longer to write.
constexpr int kSeriesFrameCount = 12;
constexpr int kSeriesCutCount = 3;
constexpr int kSeriesWakeCount = 4;
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr std::int64_t kBoundedFrameCount = 240;
constexpr std::int64_t kBoundedSeriesFrameCount = 144;
constexpr std::int64_t kBoundedLevelFrameCount = 144;
constexpr std::int64_t kBoundedBoundsCount = 24;
#else
constexpr std::int64_t kBoundedFrameCount = 1200;
constexpr std::int64_t kBoundedSeriesFrameCount = 720;
constexpr std::int64_t kBoundedLevelFrameCount = 720;
constexpr std::int64_t kBoundedBoundsCount = 200;
#endif
// Threads that rounds of levels draw.
constexpr std::array<int, 6> kLevelThreadCounts = {1, 2, 3, 8, 32, 64};
constexpr absl::Duration kProgressPeriod = absl::Seconds(10);
// A round that takes longer hangs.
constexpr absl::Duration kMaxRoundDuration = absl::Minutes(5);

// Says how to repeat the round that ended the process.
std::array<char, 160> last_words{};
std::size_t last_words_size = 0;

void SayLastWords(int number) {
  // Nothing can be done if it fails.
  [[maybe_unused]] const ssize_t written = write(STDERR_FILENO, last_words.data(), last_words_size);
  std::signal(number, SIG_DFL);
  std::raise(number);
}

// Ends the process, with a seed to repeat it, if a round crashes or hangs. Thread-compatible.
class Watchdog {
 public:
  Watchdog() : thread_([this] { Watch(); }) {
    std::signal(SIGABRT, SayLastWords);
    std::signal(SIGSEGV, SayLastWords);
  }
  ~Watchdog() {
    {
      const base::MutexLock lock(&mutex_);
      is_done_ = true;
    }
    changed_.SignalAll();
    thread_.join();
    std::signal(SIGABRT, SIG_DFL);
    std::signal(SIGSEGV, SIG_DFL);
  }
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;

  void BeginRound(std::uint64_t seed) {
    const std::string words =
        absl::StrFormat("soak_test: repeat it with ISOSCOPE_SOAK_SEED=%d\n", seed);
    last_words_size = words.copy(last_words.data(), last_words.size());
    const base::MutexLock lock(&mutex_);
    ++round_;
  }

 private:
  void Watch() {
    const base::MutexLock lock(&mutex_);
    while (!is_done_) {
      const std::int64_t round = round_;
      if (!changed_.AwaitUntil(&mutex_, base::MonotonicNow() + kMaxRoundDuration,
                               [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return is_done_; }) &&
          round_ == round && round > 0) {
        std::cerr << "soak_test: a round has not ended in " << kMaxRoundDuration << "\n";
        std::abort();
      }
    }
  }

  base::Mutex mutex_;
  base::CondVar changed_;
  std::int64_t round_ ABSL_GUARDED_BY(mutex_) = 0;
  bool is_done_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;  // last: it uses all of the above
};

struct Volume {
  volume::GridGeometry geometry;
  volume::ScalarType type = volume::ScalarType::kUint8;
  std::string samples;
  std::vector<double> isovalues;
  std::vector<double> labels;  // of a segmentation; else empty
};

volume::GridGeometry RandomGeometry(Dice* dice, std::int64_t max_side) {
  volume::GridGeometry geometry;
  const auto side = [&] { return dice->OneIn(5) ? dice->Whole(2, 6) : dice->Whole(7, max_side); };
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

// On the geometry, of the type.
void DrawSamples(Dice* dice, Volume* drawn) {
  Volume& volume = *drawn;
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
}

Volume RandomVolume(Dice* dice, std::int64_t max_side) {
  Volume volume;
  volume.geometry = RandomGeometry(dice, max_side);
  volume.type = static_cast<volume::ScalarType>(dice->Whole(1, 8));
  DrawSamples(dice, &volume);
  return volume;
}

// Regions of a few labels, with islands of single samples.
std::string LabelSamples(const std::vector<double>& labels, const math::Index3& dims,
                         volume::ScalarType type, Dice* dice) {
  const auto last = static_cast<std::int64_t>(labels.size()) - 1;
  const auto any_label = [&] { return labels[static_cast<std::size_t>(dice->Whole(0, last))]; };
  struct Seed {
    math::Vec3d position;
    double label = 0;
  };
  std::vector<Seed> seeds;
  for (std::int64_t i = dice->Whole(2, 12); i > 0; --i) {
    const auto on = [&](std::int64_t side) { return static_cast<double>(side) * dice->Unit(); };
    seeds.push_back({{on(dims.x), on(dims.y), on(dims.z)}, any_label()});
  }
  const std::int64_t island_share = dice->OneOf<std::int64_t, 4>({0, 40, 4, 1});
  std::string samples;
  volume::VisitScalarType(type, [&]<typename T>() {
    for (std::int64_t z = 0; z < dims.z; ++z) {
      for (std::int64_t y = 0; y < dims.y; ++y) {
        for (std::int64_t x = 0; x < dims.x; ++x) {
          const math::Vec3d at{static_cast<double>(x), static_cast<double>(y),
                               static_cast<double>(z)};
          const auto nearest =
              std::min_element(seeds.begin(), seeds.end(), [&](const Seed& a, const Seed& b) {
                return math::Length(a.position - at) < math::Length(b.position - at);
              });
          const bool is_island = island_share > 0 && dice->OneIn(island_share);
          const auto sample = static_cast<T>(is_island ? any_label() : nearest->label);
          samples.append(reinterpret_cast<const char*>(&sample), sizeof(T));
        }
      }
    }
  });
  return samples;
}

// A segmentation, of any type.
Volume RandomSegmentation(Dice* dice, std::int64_t max_side) {
  Volume volume;
  volume.geometry = RandomGeometry(dice, max_side);
  volume.type = static_cast<volume::ScalarType>(dice->Whole(1, 8));
  const bool is_float =
      volume.type == volume::ScalarType::kFloat32 || volume.type == volume::ScalarType::kFloat64;
  for (std::int64_t i = dice->Whole(2, 6); i > 0; --i) {
    const double fraction = is_float && dice->OneIn(3) ? 0.5 : 0;
    const double label = static_cast<double>(dice->Whole(0, 9)) + fraction;
    if (std::find(volume.labels.begin(), volume.labels.end(), label) == volume.labels.end()) {
      volume.labels.push_back(label);
    }
  }
  volume.samples = LabelSamples(volume.labels, volume.geometry.sample_dims, volume.type, dice);
  if (dice->OneIn(3) && volume.type == volume::ScalarType::kFloat32) {
    Spoil<float>(dice, &volume.samples);
  }
  if (dice->OneIn(3) && volume.type == volume::ScalarType::kFloat64) {
    Spoil<double>(dice, &volume.samples);
  }
  volume.isovalues = {volume.labels.front(), volume.labels.back() - 0.5};
  return volume;
}

partition::PartitionOptions RandomCut(const math::Index3& block_cells, int shard_count, Dice* dice,
                                      const std::string& directory) {
  partition::PartitionOptions options;
  options.output_directory = directory;
  options.block_cells = block_cells;
  options.shard_count = shard_count;
  options.distribution =
      dice->OneIn(2) ? store::Distribution::kRandom : store::Distribution::kGreedy;
  options.compression = dice->OneOf<store::BlockEncoding, 4>(
      {store::BlockEncoding::kRaw, store::BlockEncoding::kLz4, store::BlockEncoding::kZstd,
       store::BlockEncoding::kPacked});
  options.seed = dice->Bits();
  return options;
}

// Makes a dataset of the volume.
absl::Status Cut(const Volume& volume, const math::Index3& block_cells, int shard_count, Dice* dice,
                 const std::string& directory) {
  const auto source =
      testing::MakeMemorySource(volume.geometry, volume.type, volume.samples, "soak");
  return partition::Partition(*source, RandomCut(block_cells, shard_count, dice, directory),
                              base::Cancellation())
      .status();
}

// Levels that a round's volume has.
struct RoundLevels {
  int highest = 0;
  volume::LevelFilter filter = volume::LevelFilter::kMean;
};

constexpr char kColorField[] = "color";
constexpr char kColorSuffix[] = "_color";

// Makes a dataset of the volume, and one of the other that is cut alike, with levels by means.
absl::Status CutBoth(const Volume& volume, const Volume& color, const math::Index3& block_cells,
                     int shard_count, Dice* dice, const std::string& directory,
                     const RoundLevels& levels = {}) {
  partition::PartitionOptions options = RandomCut(block_cells, shard_count, dice, directory);
  options.distribution = store::Distribution::kRandom;
  for (const Volume* const of : {&volume, &color}) {
    options.output_directory = of == &volume ? directory : directory + kColorSuffix;
    options.levels = {.highest = levels.highest,
                      .filter = of == &volume ? levels.filter : volume::LevelFilter::kMean};
    const auto source = testing::MakeMemorySource(of->geometry, of->type, of->samples, "soak");
    ISOSCOPE_RETURN_IF_ERROR(partition::Partition(*source, options, base::Cancellation()).status());
  }
  return absl::OkStatus();
}

// The same of one agent, with levels that do not come from partitioning.
absl::Status CutBothPlainly(const Volume& volume, const Volume& color,
                            const math::Index3& block_cells, Dice* dice,
                            const std::string& directory, const RoundLevels& levels) {
  ISOSCOPE_RETURN_IF_ERROR(CutBoth(volume, color, block_cells, 1, dice, directory));
  ISOSCOPE_RETURN_IF_ERROR(
      testing::AddLevelFiles(directory, volume.samples, levels.highest, levels.filter).status());
  return testing::AddLevelFiles(directory + kColorSuffix, color.samples, levels.highest,
                                volume::LevelFilter::kMean)
      .status();
}

RoundLevels RandomLevels(const math::Index3& dims, Dice* dice) {
  return {.highest = static_cast<int>(
              std::min<std::int64_t>(volume::HighestLevel(dims), dice->Whole(1, 3)))};
}

// The most shards that can have a block of each level.
std::int64_t MaxShardsOf(const math::Index3& dims, const math::Index3& cells, int highest_level) {
  return volume::BlockLayout::Make(volume::LevelDims(dims, highest_level), cells)->block_count();
}

// Fields over steps on one grid.
class Series final : public source::VolumeSeries {
 public:
  static Series Random(Dice* dice, std::int64_t max_side) {
    source::SeriesInfo info{.name = "soak"};
    const volume::GridGeometry geometry = RandomGeometry(dice, max_side);
    const auto field_count = static_cast<std::size_t>(dice->Whole(2, 3));
    for (std::size_t field = 0; field < field_count; ++field) {
      const std::array<std::vector<std::string>, 4> components = {
          {{""}, {""}, {"x", "y"}, {"x", "y", "z"}}};
      info.fields.push_back(
          {.name = absl::StrFormat("field%d", field), .components = dice->OneOf(components)});
    }
    const std::int64_t step_count = dice->OneIn(8) ? 1 : dice->Whole(2, 4);
    for (std::int64_t step = 0; step_count > 1 && step < step_count; ++step) {
      info.times.push_back(static_cast<double>(step) + 0.9 * dice->Unit());
    }
    Series series(std::move(info), geometry);
    for (std::size_t field = 0; field < field_count; ++field) {
      const auto type = static_cast<volume::ScalarType>(dice->Whole(1, 8));
      std::vector<std::vector<Volume>>& steps = series.volumes_.emplace_back();
      for (std::int64_t step = 0; step < step_count; ++step) {
        // Volumes of equal samples have equal ids.
        if (step > 0 && dice->OneIn(5)) {
          steps.push_back(std::vector<Volume>(steps.back()));
          continue;
        }
        std::vector<Volume>& volumes = steps.emplace_back();
        for (std::size_t i = 0; i < series.info().fields[field].components.size(); ++i) {
          Volume& volume = volumes.emplace_back();
          volume.geometry = series.geometry_;
          volume.type = type;
          DrawSamples(dice, &volume);
        }
      }
    }
    return series;
  }

  absl::StatusOr<std::unique_ptr<source::VolumeSource>> Open(int field, int component,
                                                             int step) override {
    const Volume& volume =
        VolumesOf({.field = field, .step = step})[static_cast<std::size_t>(component)];
    return testing::MakeMemorySource(volume.geometry, volume.type, volume.samples, "soak");
  }
  absl::StatusOr<std::string> IdentityOfStep(int /*step*/) override { return info().name; }

  [[nodiscard]] const volume::GridGeometry& geometry() const { return geometry_; }
  // With the magnitude.
  [[nodiscard]] int ComponentCount(int field) const {
    const std::size_t count = info().field(field).components.size();
    return static_cast<int>(count > 1 ? count + 1 : 1);
  }
  [[nodiscard]] store::ScalarVolumeKey RandomKey(Dice* dice) const {
    store::ScalarVolumeKey key;
    key.field =
        static_cast<int>(dice->Whole(0, static_cast<std::int64_t>(info().fields.size()) - 1));
    key.component = static_cast<int>(dice->Whole(0, ComponentCount(key.field) - 1));
    key.step = static_cast<int>(dice->Whole(0, info().step_count() - 1));
    return key;
  }
  [[nodiscard]] std::vector<double> IsovaluesOf(const store::ScalarVolumeKey& key) const {
    const std::vector<Volume>& volumes = VolumesOf(key);
    if (static_cast<std::size_t>(key.component) < volumes.size()) {
      return volumes[static_cast<std::size_t>(key.component)].isovalues;
    }
    std::vector<double> isovalues(2, 0);
    for (std::size_t i = 0; i < isovalues.size(); ++i) {
      for (const Volume& volume : volumes) {
        isovalues[i] = std::hypot(isovalues[i], volume.isovalues[i]);
      }
    }
    return isovalues;
  }
  // The array, or the magnitude, alone.
  absl::StatusOr<std::unique_ptr<source::VolumeSource>> OpenAlone(
      const store::ScalarVolumeKey& key) {
    const std::size_t count = VolumesOf(key).size();
    if (static_cast<std::size_t>(key.component) < count) {
      return Open(key.field, key.component, key.step);
    }
    std::vector<std::unique_ptr<source::VolumeSource>> components(count);
    for (std::size_t i = 0; i < count; ++i) {
      ISOSCOPE_ASSIGN_OR_RETURN(components[i], Open(key.field, static_cast<int>(i), key.step));
    }
    return source::MakeMagnitudeSource(std::move(components));
  }
  // The steps from `begin` on, or those before it. REQUIRES: there are times.
  [[nodiscard]] Series From(std::int64_t begin) const { return Part(begin, info().step_count()); }
  [[nodiscard]] Series Before(std::int64_t end) const { return Part(0, end); }

 private:
  Series(source::SeriesInfo info, const volume::GridGeometry& geometry)
      : VolumeSeries(std::move(info)), geometry_(geometry) {}

  [[nodiscard]] const std::vector<Volume>& VolumesOf(const store::ScalarVolumeKey& key) const {
    return volumes_[static_cast<std::size_t>(key.field)][static_cast<std::size_t>(key.step)];
  }
  [[nodiscard]] Series Part(std::int64_t begin, std::int64_t end) const {
    source::SeriesInfo some = info();
    some.times.assign(info().times.begin() + begin, info().times.begin() + end);
    Series part(std::move(some), geometry_);
    for (const auto& steps : volumes_) {
      part.volumes_.emplace_back(steps.begin() + begin, steps.begin() + end);
    }
    return part;
  }

  volume::GridGeometry geometry_;
  std::vector<std::vector<std::vector<Volume>>> volumes_;  // by field, step and component
};

// Makes a dataset of the series: at once, or of its first steps, and the others are appended.
absl::Status CutSeries(const Series& series, const math::Index3& block_cells, int shard_count,
                       const RoundLevels& levels, Dice* dice, const std::string& directory) {
  partition::SeriesPartitionOptions options;
  options.volume = RandomCut(block_cells, shard_count, dice, directory);
  options.volume.levels = {.highest = levels.highest, .filter = levels.filter};
  options.volume.distribution = store::Distribution::kRandom;
  if (series.info().times.empty() || !dice->OneIn(3)) {
    Series whole = series;
    return partition::PartitionSeries(whole, options, base::Cancellation()).status();
  }
  const std::int64_t begin = dice->Whole(1, series.info().step_count() - 1);
  Series first = series.Before(begin);
  ISOSCOPE_RETURN_IF_ERROR(
      partition::PartitionSeries(first, options, base::Cancellation()).status());
  Series later = series.From(begin);
  partition::SeriesPartitionOptions appending;
  appending.volume.output_directory = directory;
  appending.volume.compression = options.volume.compression;
  return partition::AppendToSeries(later, appending, base::Cancellation()).status();
}

std::size_t RandomCacheBytes(Dice* dice) {
  constexpr std::array<std::size_t, 4> kCacheSizes = {0, std::size_t{1} << 18, std::size_t{1} << 22,
                                                      LocalCluster::kAmpleCacheBytes};
  return dice->OneOf(kCacheSizes);
}

math::Index3 RandomBlockCells(Dice* dice, std::int64_t min_edge, std::int64_t max_edge) {
  const auto edge = [&] { return dice->Whole(min_edge, max_edge); };
  if (dice->OneIn(3)) {
    return {edge(), edge(), edge()};
  }
  const std::int64_t same = edge();
  return {same, same, same};
}

// Every option of a frame that agents see.
frame::FrameSpec RandomSmallFrame(const math::Box3d& bounds, const std::vector<double>& isovalues,
                                  Dice* dice) {
  const std::uint64_t seed = dice->Bits();
  const double isovalue = isovalues[static_cast<std::size_t>(dice->Whole(0, 1))];
  frame::FrameSpec spec = testing::RandomSpec(seed, bounds, isovalue);
  spec.viewport = {static_cast<int>(dice->Whole(48, 96)), static_cast<int>(dice->Whole(48, 96))};
  if (dice->OneIn(3)) {
    spec.surfaces = testing::ThreeSurfaces(isovalue, isovalues[1] - isovalues[0] + 0.5);
  }
  if (dice->OneIn(3)) {
    testing::MakeRandomlyTranslucent(seed, &spec);
  }
  if (dice->OneIn(3)) {
    spec.clip = testing::RandomClip(seed, bounds);
    testing::AddRandomCaps(seed, &spec);
  }
  if (dice->OneIn(4)) {
    testing::AddRandomLook(seed, &spec);
  }
  return spec;
}

// Gives a frame one to five surfaces, most of them of labels.
void ShowRandomLabels(const std::vector<double>& labels, Dice* dice, frame::FrameSpec* spec) {
  const auto last = static_cast<std::int64_t>(labels.size()) - 1;
  spec->surfaces.resize(static_cast<std::size_t>(dice->Whole(1, 5)), spec->surfaces.front());
  for (frame::Surface& surface : spec->surfaces) {
    const auto channel = [&] { return static_cast<std::uint8_t>(dice->Whole(0, 255)); };
    surface.appearance.base_color = {channel(), channel(), channel(), 255};
    if (dice->OneIn(5)) {
      continue;  // of the isovalue
    }
    std::vector<double> chosen;
    for (std::int64_t i = dice->Whole(1, 3); i > 0; --i) {
      chosen.push_back(labels[static_cast<std::size_t>(dice->Whole(0, last))]);
    }
    if (dice->OneIn(4)) {
      chosen.push_back(-3.25);  // no sample
    }
    surface.rule = volume::InsideRule::OfLabels(chosen);
    if (surface.shows_gradient()) {
      surface.color_by->quantity = frame::ColorBy::Quantity::kPositionY;
    }
  }
  spec->sends_map_steps = frame::ShowsValues(*spec);
}

// A frame of a segmentation; `color` is the field that it may show.
frame::FrameSpec RandomLabelFrame(const Volume& volume, const std::string& color, Dice* dice) {
  frame::FrameSpec spec = RandomSmallFrame(volume.geometry.Bounds(), volume.isovalues, dice);
  ShowRandomLabels(volume.labels, dice, &spec);
  if (dice->OneIn(3)) {
    testing::MakeRandomlyTranslucent(dice->Bits(), &spec);
  }
  if (dice->OneIn(4)) {
    testing::ShowRandomFields(dice->Bits(), {color}, &spec);
  }
  return spec;
}

// Chooses a level by name or by the distance of samples, and effects of the picture. Positions show
// the box of level 0 at every level, as the coordinator has it.
void ChooseRandomLevel(const volume::GridGeometry& whole, int highest, Dice* dice,
                       frame::FrameSpec* spec) {
  if (dice->OneIn(4)) {
    spec->effects.samples_per_side = static_cast<int>(dice->Whole(2, 4));
    spec->viewport = {static_cast<int>(dice->Whole(24, 48)), static_cast<int>(dice->Whole(24, 48))};
  }
  if (dice->OneIn(5)) {
    spec->effects.ambient_occlusion = {.radius_px = static_cast<int>(dice->Whole(4, 12)),
                                       .strength = static_cast<float>(dice->Unit())};
  }
  if (dice->OneIn(5)) {
    spec->effects.silhouette = {.width_px = static_cast<int>(dice->Whole(1, 4))};
  }
  spec->level = static_cast<int>(dice->Whole(0, highest));
  const double max_spacing_px = std::pow(10, 3 * dice->Unit() - 1);
  const auto view = view::View::Make(*spec->camera, spec->viewport, whole);
  if (dice->OneIn(3) && view.ok()) {
    spec->level = view::CoarsestLevel(whole, view::PixelsPerUnit(*view, spec->clip.box),
                                      max_spacing_px, highest);
  }
  for (frame::Surface& surface : spec->surfaces) {
    using Quantity = frame::ColorBy::Quantity;
    if (surface.color_by.has_value() && (surface.color_by->quantity == Quantity::kPositionX ||
                                         surface.color_by->quantity == Quantity::kPositionY ||
                                         surface.color_by->quantity == Quantity::kPositionZ)) {
      surface.color_by->range = picture::ColorRangeOf(*surface.color_by, whole);
    }
  }
}

// A frame of a volume with levels, or of a segmentation.
frame::FrameSpec RandomLevelFrame(const Volume& volume, const RoundLevels& levels,
                                  const std::string& color, Dice* dice) {
  frame::FrameSpec spec;
  if (volume.labels.empty()) {
    spec = RandomSmallFrame(volume.geometry.Bounds(), volume.isovalues, dice);
    if (dice->OneIn(4)) {
      testing::ShowRandomFields(dice->Bits(), {color}, &spec);
    }
  } else {
    spec = RandomLabelFrame(volume, color, dice);
  }
  ChooseRandomLevel(volume.geometry, levels.highest, dice, &spec);
  return spec;
}

// A frame to compare.
struct SmallFrame {
  frame::FrameSpec spec;
  image::FrameImage expected;                    // colours and depths, with shades and layers
  std::optional<store::ScalarVolumeKey> volume;  // of a series
  // Blocks of the reference, if the picture depends on them.
  std::optional<math::Index3> only_cells;
};

// The picture of a frame, and what it has of layers.
struct DrawnFrame {
  image::FrameImage image;
  std::int64_t covered_pixels = 0;
  std::int64_t layer_pixels = 0;
};

// Draws a frame, with all that the coordinator does to its pixels. `volume` is that of a series,
// else not set; `arena` may be null.
absl::StatusOr<DrawnFrame> DrawFinished(const volume::GridGeometry& whole,
                                        const math::Index3& block_cells,
                                        const frame::FrameSpec& spec,
                                        const std::optional<store::ScalarVolumeKey>& volume,
                                        render::RendererKind kind, base::TaskArena* arena,
                                        LocalCluster* cluster) {
  const frame::DrawnWindow window = frame::DrawnWindowOf(spec);
  frame::FrameSpec drawn = spec;
  drawn.viewport = window.viewport;
  drawn.region = window.region;
  drawn.effects = {};
  drawn.sends_normals = picture::NeedsDeferredShading(spec);
  drawn.sends_map_steps = frame::ShowsValues(spec);
  ISOSCOPE_ASSIGN_OR_RETURN(server::FrameResult result, volume.has_value()
                                                            ? cluster->Render(drawn, *volume)
                                                            : cluster->Render(drawn));
  const volume::GridGeometry grid = testing::GridOfLevel(whole, spec.level);
  ISOSCOPE_ASSIGN_OR_RETURN(view::View view,
                            view::View::Make(*spec.camera, window.viewport, whole, window.region));
  ISOSCOPE_ASSIGN_OR_RETURN(view, view.OnGrid(grid));
  ISOSCOPE_ASSIGN_OR_RETURN(const auto layout,
                            volume::BlockLayout::Make(grid.sample_dims, block_cells));
  const frame::BackEnd back_end =
      kind == render::RendererKind::kEgl ? frame::BackEnd::kEgl : frame::BackEnd::kCpu;
  DrawnFrame finished;
  finished.covered_pixels = testing::CoveredPixels(result.image);
  if (!result.layers.empty()) {
    finished.layer_pixels = testing::CoveredPixels(*result.layers.LayerImages().front());
  }
  const std::shared_ptr<image::FrameImagePool> images = image::FrameImagePool::Make(0);
  const server::PictureSetup setup{
      .spec = &spec,
      .window = &window,
      .drawn_view = &view,
      .order = {.block_count = static_cast<std::uint32_t>(layout.block_count()),
                .ties = frame::TieRuleOf(frame::DrawnBy(spec, back_end))},
      .layers = &result.layers,
      .images = images.get()};
  const auto finish = [&] { return server::FinishPicture(setup, &result.image).image; };
  finished.image = arena == nullptr ? finish() : base::RunIn(arena, finish);
  return finished;
}

// The numbers of a run of small frames.
struct Tally {
  void Add(const testing::Limits& limits, std::int64_t count) {
    by_threads[limits.thread_count] += count;
    by_limit[limits.memory_limit_bytes == testing::Limits::kNoMemoryLimit
                 ? 0
                 : (static_cast<int>(std::bit_width(limits.memory_limit_bytes)) + 3) / 4] += count;
  }
  [[nodiscard]] std::string ToString() const {
    std::string text = "threads";
    for (const auto& [threads, count] : by_threads) {
      absl::StrAppendFormat(&text, "%s%d: %d", threads == 1 ? " " : ", ", threads, count);
    }
    text += "; memory limits";
    for (const auto& [bits, count] : by_limit) {
      if (bits == 0) {
        absl::StrAppendFormat(&text, " none: %d", count);
      } else {
        absl::StrAppendFormat(&text, ", below 2^%d bytes: %d", 4 * bits, count);
      }
    }
    return text;
  }

  std::int64_t frames = 0;
  std::int64_t references = 0;
  std::int64_t covered_pixels = 0;  // of the references
  std::int64_t layer_pixels = 0;
  // References of series that show another field, and those of a magnitude.
  std::int64_t colored_by_field = 0;
  std::int64_t magnitudes = 0;
  std::int64_t label_surfaces = 0;         // of all references
  std::int64_t with_effects = 0;           // references with samples, occlusion or silhouettes
  std::map<int, std::int64_t> by_level;    // frames
  std::map<int, std::int64_t> by_threads;  // frames
  // Frames by memory limit, from 2^(4 (i - 1)) bytes to below 2^(4 i); 0: none.
  std::map<int, std::int64_t> by_limit;
};

// A number in the environment; the default if there is none.
template <typename T>
T EnvironmentNumber(const char* name, T otherwise) {
  // NOLINTNEXTLINE(concurrency-mt-unsafe): nobody sets variables
  const char* const text = std::getenv(name);
  if (text == nullptr) {
    return otherwise;
  }
  T value = 0;
  if constexpr (std::is_floating_point_v<T>) {
    EXPECT_TRUE(absl::SimpleAtod(text, &value)) << name << "=" << text;
  } else {
    EXPECT_TRUE(absl::SimpleAtoi(text, &value)) << name << "=" << text;
  }
  return value;
}

// The seed of the first round. Long runs have new seeds each time.
std::uint64_t FirstSeed(bool is_long) {
  return EnvironmentNumber<std::uint64_t>(
      "ISOSCOPE_SOAK_SEED", is_long ? std::uint64_t{std::random_device()()} << 16 : 1);
}

class SoakTest : public ::testing::TestWithParam<render::RendererKind> {
 protected:
  void SetUp() override {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        renderer_, testing::MakeSharedRenderer(GetParam(), testing::DrawSeed("renderer")));
  }

  // One volume, cut twice: without culling by one agent, with culling by many, side by side.
  void RunRound(std::uint64_t seed) {
    Dice dice(seed);
    const Volume volume = RandomVolume(&dice, 60);
    const math::Index3& dims = volume.geometry.sample_dims;
    const math::Index3 block_cells = RandomBlockCells(&dice, 1, 20);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto layout, volume::BlockLayout::Make(dims, block_cells));
    const auto shard_count = static_cast<int>(std::min(layout.block_count(), dice.Whole(1, 16)));
    SCOPED_TRACE(
        absl::StrFormat("seed %d: %d x %d x %d of type %d, blocks of %d x %d x %d, %d shards", seed,
                        dims.x, dims.y, dims.z, static_cast<int>(volume.type), block_cells.x,
                        block_cells.y, block_cells.z, shard_count));
    const testing::TempDir temp;
    ISOSCOPE_ASSERT_OK(Cut(volume, block_cells, 1, &dice, temp.Sub("one")));
    ISOSCOPE_ASSERT_OK(Cut(volume, block_cells, shard_count, &dice, temp.Sub("many")));
    std::vector<frame::FrameSpec> requests;
    std::vector<server::FrameResult> expected;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto one, LocalCluster::Open(temp.Sub("one"), renderer_.get(),
                                           testing::DrawLimits(&dice), RandomCacheBytes(&dice)));
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
          << "view " << view << ", one agent, " << one->limits();
      culled_view_count_ += testing::TriangleCount(culled) < testing::TriangleCount(result) ? 1 : 0;
      requests.push_back(request);
      expected.push_back(std::move(result));
    }
    one->Sleep();
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto many, LocalCluster::Open(temp.Sub("many"), renderer_.get(),
                                            testing::DrawLimits(&dice), RandomCacheBytes(&dice)));
    const bool side_by_side = dice.OneIn(2);
    std::vector<std::thread> clients;
    for (std::size_t view = 0; view < requests.size(); ++view) {
      const auto check = [&, view] {
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const server::FrameResult result,
                                      many->Render(requests[view]));
        EXPECT_EQ(testing::Compare(result.image, expected[view].image), testing::Difference())
            << "view " << view << (side_by_side ? ", beside others, " : ", ") << many->limits();
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

  // Draws frames of the volume without culling: one agent, two threads, no limit.
  void DrawReferences(const Volume& volume, const math::Index3& cells, const std::string& directory,
                      Dice* dice, std::vector<SmallFrame>* frames) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster,
                                  LocalCluster::Open(directory, renderer_.get(), {}));
    for (int i = 0; i < kSmallFrameCount; ++i) {
      SmallFrame& frame = frames->emplace_back();
      frame.spec = RandomSmallFrame(volume.geometry.Bounds(), volume.isovalues, dice);
      DrawReference(volume.geometry, cells, cluster.get(), dice, &frame);
    }
  }

  // Draws frames of a segmentation likewise; the samples of `color` may colour them.
  void DrawLabelReferences(const Volume& volume, const math::Index3& cells,
                           const std::string& directory, const std::string& color, Dice* dice,
                           std::vector<SmallFrame>* frames) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster,
                                  LocalCluster::Open(directory, renderer_.get(), {}));
    ISOSCOPE_ASSERT_OK(cluster->AddField(kColorField, color));
    for (int i = 0; i < kSmallFrameCount; ++i) {
      SmallFrame& frame = frames->emplace_back();
      frame.spec = RandomLabelFrame(volume, kColorField, dice);
      for (const frame::Surface& surface : frame.spec.surfaces) {
        tally_.label_surfaces += surface.rule.has_labels() ? 1 : 0;
      }
      tally_.colored_by_field +=
          std::any_of(frame.spec.surfaces.begin(), frame.spec.surfaces.end(),
                      [](const frame::Surface& surface) { return surface.shows_field(); })
              ? 1
              : 0;
      DrawReference(volume.geometry, cells, cluster.get(), dice, &frame);
    }
  }

  // Draws the frame as it is expected, and then chooses a part of it and its culling.
  void DrawReference(const volume::GridGeometry& geometry, const math::Index3& cells,
                     LocalCluster* cluster, Dice* dice, SmallFrame* frame) {
    frame->spec.culling = frame->only_cells ? frame::Culling::kMask : frame::Culling::kNone;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        DrawnFrame drawn, DrawFinished(geometry, cells, frame->spec, /*volume=*/std::nullopt,
                                       GetParam(), /*arena=*/nullptr, cluster));
    frame->expected = std::move(drawn.image);
    tally_.covered_pixels += drawn.covered_pixels;
    tally_.layer_pixels += drawn.layer_pixels;
    ++tally_.references;
    if (frame->only_cells) {
      return;
    }
    if (dice->OneIn(4)) {
      frame->spec.region = testing::RandomRegion(dice->Bits(), frame->spec.viewport);
      frame->expected = testing::Crop(frame->expected, *frame->spec.region);
    }
    if (!dice->OneIn(6)) {
      frame->spec.culling = frame::Culling::kDepth;
    }
  }

  // Draws the frames, and compares colours and depths: owners tell how the volume was cut.
  void CheckFrames(const volume::GridGeometry& geometry, const math::Index3& cells,
                   const std::vector<SmallFrame>& frames, bool side_by_side, base::TaskArena* arena,
                   LocalCluster* cluster) {
    std::vector<testing::Difference> differences(frames.size());
    std::vector<std::thread> clients;
    std::int64_t count = 0;
    for (std::size_t i = 0; i < frames.size(); ++i) {
      if (frames[i].only_cells.has_value() && *frames[i].only_cells != cells) {
        continue;
      }
      ++count;
      ++tally_.by_level[frames[i].spec.level];
      const auto draw = [&, i] {
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(
            const DrawnFrame drawn, DrawFinished(geometry, cells, frames[i].spec, frames[i].volume,
                                                 GetParam(), arena, cluster));
        differences[i] = testing::Compare(drawn.image, frames[i].expected);
      };
      if (side_by_side) {
        clients.emplace_back(draw);
      } else {
        draw();
      }
    }
    for (std::thread& client : clients) {
      client.join();
    }
    for (std::size_t i = 0; i < frames.size(); ++i) {
      const std::string name =
          frames[i].volume ? store::ScalarVolumeDirectoryName(*frames[i].volume) : "";
      const int level = frames[i].spec.level;
      EXPECT_EQ(differences[i].colors, 0) << "frame " << i << " " << name << ", level " << level;
      EXPECT_EQ(differences[i].depths, 0) << "frame " << i << " " << name << ", level " << level;
    }
    tally_.frames += count;
    tally_.Add(cluster->limits(), count);
  }

  // One small volume, cut several times, each cut with several limits.
  void RunSmallRound(std::uint64_t seed) {
    Dice dice(seed);
    const Volume volume = RandomVolume(&dice, 24);
    const math::Index3& dims = volume.geometry.sample_dims;
    const testing::TempDir temp;
    const math::Index3 first_cells = RandomBlockCells(&dice, 2, 10);
    ISOSCOPE_ASSERT_OK(Cut(volume, first_cells, 1, &dice, temp.Sub("one")));
    std::vector<SmallFrame> frames;
    DrawReferences(volume, first_cells, temp.Sub("one"), &dice, &frames);
    // One arena for all cuts: on a busy machine it takes long until all of its threads have run.
    const int thread_count = dice.OneOf(testing::kThreadCounts);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto arena, testing::MakeOnlyArena(thread_count));
    for (int cut = 0; cut < kCutCount && !HasFailure(); ++cut) {
      // OpenGL's pictures depend on how the volume is cut into blocks.
      const bool has_first_cells = cut == 0 || GetParam() == render::RendererKind::kEgl;
      const math::Index3 cells = has_first_cells ? first_cells : RandomBlockCells(&dice, 2, 10);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto layout, volume::BlockLayout::Make(dims, cells));
      const auto shard_count = static_cast<int>(std::min(layout.block_count(), dice.Whole(1, 8)));
      const std::string directory = temp.Sub(absl::StrFormat("cut%d", cut));
      ISOSCOPE_ASSERT_OK(Cut(volume, cells, shard_count, &dice, directory));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster,
                                    LocalCluster::OpenAsleep(directory, renderer_.get()));
      SCOPED_TRACE(::testing::Message()
                   << "seed " << seed << ": " << dims.x << " x " << dims.y << " x " << dims.z
                   << " of type " << static_cast<int>(volume.type) << ", blocks of " << cells.x
                   << " x " << cells.y << " x " << cells.z << ", " << shard_count << " shards");
      CheckWithLimits(volume.geometry, cells, frames, kWakeCount, arena, &dice, cluster.get());
    }
  }

  // One small segmentation and a field that colours it, cut several times, as RunSmallRound.
  void RunLabelRound(std::uint64_t seed) {
    Dice dice(seed);
    const Volume volume = RandomSegmentation(&dice, 24);
    Volume color = volume;
    color.type = static_cast<volume::ScalarType>(dice.Whole(1, 8));
    DrawSamples(&dice, &color);
    const math::Index3& dims = volume.geometry.sample_dims;
    const testing::TempDir temp;
    const math::Index3 first_cells = RandomBlockCells(&dice, 2, 10);
    ISOSCOPE_ASSERT_OK(CutBoth(volume, color, first_cells, 1, &dice, temp.Sub("one")));
    std::vector<SmallFrame> frames;
    DrawLabelReferences(volume, first_cells, temp.Sub("one"), temp.Sub("one") + kColorSuffix, &dice,
                        &frames);
    const int thread_count = dice.OneOf(testing::kThreadCounts);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto arena, testing::MakeOnlyArena(thread_count));
    for (int cut = 0; cut < kCutCount && !HasFailure(); ++cut) {
      const bool has_first_cells = cut == 0 || GetParam() == render::RendererKind::kEgl;
      const math::Index3 cells = has_first_cells ? first_cells : RandomBlockCells(&dice, 2, 10);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto layout, volume::BlockLayout::Make(dims, cells));
      const auto shard_count = static_cast<int>(std::min(layout.block_count(), dice.Whole(1, 8)));
      const std::string directory = temp.Sub(absl::StrFormat("cut%d", cut));
      ISOSCOPE_ASSERT_OK(CutBoth(volume, color, cells, shard_count, &dice, directory));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster,
                                    LocalCluster::OpenAsleep(directory, renderer_.get()));
      ISOSCOPE_ASSERT_OK(cluster->AddField(kColorField, directory + kColorSuffix));
      SCOPED_TRACE(::testing::Message()
                   << "seed " << seed << ": " << dims.x << " x " << dims.y << " x " << dims.z
                   << " of type " << static_cast<int>(volume.type) << ", blocks of " << cells.x
                   << " x " << cells.y << " x " << cells.z << ", " << shard_count << " shards");
      CheckWithLimits(volume.geometry, cells, frames, kWakeCount, arena, &dice, cluster.get());
    }
  }

  // Checks the frames several times: each time with new limits, and now and then with new caches.
  void CheckWithLimits(const volume::GridGeometry& geometry, const math::Index3& cells,
                       const std::vector<SmallFrame>& frames, int wake_count,
                       const std::shared_ptr<base::TaskArena>& arena, Dice* dice,
                       LocalCluster* cluster) {
    if (dice->OneIn(3)) {
      cluster->LoseAgents();
    }
    for (int wake = 0; wake < wake_count && !HasFailure(); ++wake) {
      testing::Limits limits = testing::DrawLimits(dice);
      limits.thread_count = arena->max_concurrency();
      if (dice->OneIn(2)) {
        cluster->ForgetAll(RandomCacheBytes(dice));
      }
      const bool side_by_side = dice->OneIn(3);
      SCOPED_TRACE(::testing::Message() << limits << (side_by_side ? ", side by side" : ""));
      cluster->WakeIn(arena, limits);
      CheckFrames(geometry, cells, frames, side_by_side, arena.get(), cluster);
      cluster->Sleep();
    }
  }

  // Draws frames of volumes of the series, each from a dataset of its array alone: without culling,
  // one agent, two threads, no limit.
  void DrawSeriesReferences(Series* series, const math::Index3& cells, const RoundLevels& levels,
                            const testing::TempDir& temp, Dice* dice,
                            std::vector<SmallFrame>* frames) {
    const auto directory_of =
        [&](const store::ScalarVolumeKey& key) -> absl::StatusOr<std::string> {
      std::string directory = temp.Sub(store::ScalarVolumeDirectoryName(key));
      if (!io::PathExists(directory)) {
        ISOSCOPE_ASSIGN_OR_RETURN(const auto source, series->OpenAlone(key));
        partition::PartitionOptions options = RandomCut(cells, 1, dice, directory);
        options.levels = {.highest = levels.highest, .filter = levels.filter};
        ISOSCOPE_RETURN_IF_ERROR(
            partition::Partition(*source, options, base::Cancellation()).status());
      }
      return directory;
    };
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto arena, testing::MakeOnlyArena(2));
    for (int i = 0; i < kSeriesFrameCount && !HasFailure(); ++i) {
      SmallFrame& frame = frames->emplace_back();
      frame.volume = series->RandomKey(dice);
      frame.spec =
          RandomSmallFrame(series->geometry().Bounds(), series->IsovaluesOf(*frame.volume), dice);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string directory, directory_of(*frame.volume));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster,
                                    LocalCluster::OpenAsleep(directory, renderer_.get()));
      if (dice->OneIn(2)) {
        std::vector<std::string> names;
        for (int color = 0; color < 2; ++color) {
          store::ScalarVolumeKey key = series->RandomKey(dice);
          key.step = frame.volume->step;
          names.push_back(NameOfColor(key));
          ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string color_directory, directory_of(key));
          ISOSCOPE_ASSERT_OK(cluster->AddField(names.back(), color_directory));
        }
        testing::ShowRandomFields(dice->Bits(), names, &frame.spec);
        ++tally_.colored_by_field;
      }
      tally_.magnitudes +=
          frame.volume->component > 0 &&
                  frame.volume->component + 1 == series->ComponentCount(frame.volume->field)
              ? 1
              : 0;
      if (levels.highest > 0) {
        ChooseRandomLevel(series->geometry(), levels.highest, dice, &frame.spec);
      }
      cluster->WakeIn(arena, {});
      DrawReference(series->geometry(), cells, cluster.get(), dice, &frame);
      cluster->Sleep();
    }
  }

  static std::string NameOfColor(const store::ScalarVolumeKey& key) {
    return absl::StrFormat("%d:%d", key.field, key.component);
  }

  // One small series, cut several times, each cut with several limits.
  void RunSeriesRound(std::uint64_t seed, bool has_levels) {
    Dice dice(seed);
    Series series = Series::Random(&dice, has_levels ? 32 : 20);
    const math::Index3& dims = series.geometry().sample_dims;
    const testing::TempDir temp;
    const math::Index3 first_cells = RandomBlockCells(&dice, 2, 10);
    const RoundLevels levels = has_levels ? RandomLevels(dims, &dice) : RoundLevels();
    std::vector<SmallFrame> frames;
    DrawSeriesReferences(&series, first_cells, levels, temp, &dice, &frames);
    const int thread_count = dice.OneOf(testing::kThreadCounts);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto arena, testing::MakeOnlyArena(thread_count));
    for (int cut = 0; cut < kSeriesCutCount && !HasFailure(); ++cut) {
      const bool has_first_cells = cut == 0 || GetParam() == render::RendererKind::kEgl;
      const math::Index3 cells = has_first_cells ? first_cells : RandomBlockCells(&dice, 2, 10);
      const auto shard_count =
          static_cast<int>(std::min(MaxShardsOf(dims, cells, levels.highest), dice.Whole(1, 5)));
      SCOPED_TRACE(::testing::Message()
                   << "seed " << seed << ": " << series.info().fields.size() << " fields, "
                   << series.info().step_count() << " steps, " << dims.x << " x " << dims.y << " x "
                   << dims.z << ", blocks of " << cells.x << " x " << cells.y << " x " << cells.z
                   << ", " << shard_count << " shards");
      const std::string directory = temp.Sub(absl::StrFormat("cut%d", cut));
      ISOSCOPE_ASSERT_OK(CutSeries(series, cells, shard_count, levels, &dice, directory));
      // From one volume of one agent to all.
      const std::size_t open_volume_bytes = dice.OneIn(2) ? 1 : dice.Size(1 << 20, 1 << 28);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(
          const auto cluster,
          LocalCluster::OpenSeriesAsleep(directory, renderer_.get(), open_volume_bytes));
      for (int field = 0; field < static_cast<int>(series.info().fields.size()); ++field) {
        for (int component = 0; component < series.ComponentCount(field); ++component) {
          cluster->AddField(NameOfColor({.field = field, .component = component}), field,
                            component);
        }
      }
      CheckWithLimits(series.geometry(), cells, frames, kSeriesWakeCount, arena, &dice,
                      cluster.get());
    }
  }

  // Draws frames of levels that do not come from partitioning. One in ten is culled by the mask,
  // for which blocks matter.
  void DrawLevelReferences(const Volume& volume, const math::Index3& cells,
                           const RoundLevels& levels, const std::string& directory, Dice* dice,
                           std::vector<SmallFrame>* frames) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster,
                                  LocalCluster::Open(directory, renderer_.get(), {}));
    ISOSCOPE_ASSERT_OK(cluster->AddField(kColorField, directory + kColorSuffix));
    for (int i = 0; i < kSmallFrameCount; ++i) {
      SmallFrame& frame = frames->emplace_back();
      frame.spec = RandomLevelFrame(volume, levels, kColorField, dice);
      if (dice->OneIn(10)) {
        frame.only_cells = cells;
      }
      for (const frame::Surface& surface : frame.spec.surfaces) {
        tally_.label_surfaces += surface.rule.has_labels() ? 1 : 0;
      }
      tally_.with_effects += frame.spec.effects == frame::PictureEffects() ? 0 : 1;
      DrawReference(volume.geometry, cells, cluster.get(), dice, &frame);
    }
  }

  // One small volume with levels, or a segmentation, cut several times, as RunSmallRound.
  void RunLevelRound(std::uint64_t seed) {
    Dice dice(seed);
    if (dice.OneIn(5)) {
      RunSeriesRound(dice.Bits(), /*has_levels=*/true);
      return;
    }
    const std::int64_t max_side = dice.OneIn(4) ? 48 : 28;
    const Volume volume =
        dice.OneIn(3) ? RandomSegmentation(&dice, max_side) : RandomVolume(&dice, max_side);
    Volume color = volume;
    color.type = static_cast<volume::ScalarType>(dice.Whole(1, 8));
    DrawSamples(&dice, &color);
    const math::Index3& dims = volume.geometry.sample_dims;
    RoundLevels levels = RandomLevels(dims, &dice);
    if (!volume.labels.empty() && volume::CanFilter(volume::LevelFilter::kMajority, volume.type)) {
      levels.filter = volume::LevelFilter::kMajority;
    }
    const testing::TempDir temp;
    const math::Index3 first_cells = RandomBlockCells(&dice, 2, 10);
    ISOSCOPE_ASSERT_OK(CutBothPlainly(volume, color, first_cells, &dice, temp.Sub("one"), levels));
    std::vector<SmallFrame> frames;
    DrawLevelReferences(volume, first_cells, levels, temp.Sub("one"), &dice, &frames);
    const int thread_count = dice.OneOf(kLevelThreadCounts);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto arena, testing::MakeOnlyArena(thread_count));
    for (int cut = 0; cut < kCutCount && !HasFailure(); ++cut) {
      const bool has_first_cells = cut == 0 || GetParam() == render::RendererKind::kEgl;
      const math::Index3 cells = has_first_cells ? first_cells : RandomBlockCells(&dice, 2, 10);
      const auto shard_count =
          static_cast<int>(std::min(MaxShardsOf(dims, cells, levels.highest), dice.Whole(1, 16)));
      const std::string directory = temp.Sub(absl::StrFormat("cut%d", cut));
      ISOSCOPE_ASSERT_OK(CutBoth(volume, color, cells, shard_count, &dice, directory, levels));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster,
                                    LocalCluster::OpenAsleep(directory, renderer_.get()));
      ISOSCOPE_ASSERT_OK(cluster->AddField(kColorField, directory + kColorSuffix));
      if (dice.OneIn(3)) {
        cluster->CullByTrees();
      }
      SCOPED_TRACE(::testing::Message()
                   << "seed " << seed << ": " << dims.x << " x " << dims.y << " x " << dims.z
                   << " of type " << static_cast<int>(volume.type) << ", levels to "
                   << levels.highest << " by " << volume::NameOf(levels.filter) << ", blocks of "
                   << cells.x << " x " << cells.y << " x " << cells.z << ", " << shard_count
                   << " shards");
      CheckWithLimits(volume.geometry, cells, frames, kWakeCount, arena, &dice, cluster.get());
    }
  }

  // One small volume, one view: each pixel of the exact picture lies between its bounds.
  void RunBoundsRound(std::uint64_t seed, const std::shared_ptr<base::TaskArena>& arena) {
    Dice dice(seed);
    const Volume volume = dice.OneIn(4) ? RandomSegmentation(&dice, 32) : RandomVolume(&dice, 32);
    const math::Index3 cells = RandomBlockCells(&dice, 1, 12);
    const testing::TempDir temp;
    ISOSCOPE_ASSERT_OK(Cut(volume, cells, 1, &dice, temp.Sub("one")));
    frame::FrameSpec spec = RandomSmallFrame(volume.geometry.Bounds(), volume.isovalues, &dice);
    if (!volume.labels.empty()) {
      ShowRandomLabels(volume.labels, &dice, &spec);
    }
    if (dice.OneIn(4)) {
      spec.region = testing::RandomRegion(dice.Bits(), spec.viewport);
    }
    spec.output.depth = true;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster,
                                  LocalCluster::OpenAsleep(temp.Sub("one"), renderer_.get()));
    cluster->WakeIn(arena, {});
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const DrawnFrame exact, DrawFinished(volume.geometry, cells, spec, /*volume=*/std::nullopt,
                                             GetParam(), arena.get(), cluster.get()));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const visibility::DepthBounds bounds,
                                  BoundsOf(*cluster->shards().front()->reader, spec,
                                           static_cast<int>(dice.Whole(1, 5)), arena.get()));
    cluster->Sleep();
    CheckBounds(seed, exact.image, bounds);
    tally_.covered_pixels += exact.covered_pixels;
    tally_.layer_pixels += exact.layer_pixels;
    ++tally_.references;
  }

  // Returns the bounds of some parts, united.
  static absl::StatusOr<visibility::DepthBounds> BoundsOf(const store::ShardReader& reader,
                                                          const frame::FrameSpec& spec,
                                                          int part_count, base::TaskArena* arena) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        const view::View view,
        view::View::Make(*spec.camera, spec.viewport, reader.manifest().geometry, spec.region));
    visibility::DepthBounds bounds(view.image_size().width_px, view.image_size().height_px);
    for (int part = 0; part < part_count; ++part) {
      ISOSCOPE_ASSIGN_OR_RETURN(
          const visibility::DepthBounds of_part,
          agent::BoundsOfPart(reader, view, spec, {.part_index = part, .part_count = part_count},
                              arena, base::Cancellation()));
      bounds.UniteWith(of_part);
    }
    return bounds;
  }

  void CheckBounds(std::uint64_t seed, const image::FrameImage& exact,
                   const visibility::DepthBounds& bounds) {
    ASSERT_EQ(exact.width, bounds.width_px());
    ASSERT_EQ(exact.height, bounds.height_px());
    for (std::size_t i = 0; i < exact.pixel_count() && !HasFailure(); ++i) {
      bounded_pixels_ += 1;
      if (bounds.IsBackground(i)) {
        ++proved_background_;
      }
      if (image::OwnerOf(exact.keys[i]) == image::kNoOwner) {
        continue;
      }
      const float depth = image::DepthOf(exact.keys[i]);
      EXPECT_TRUE(bounds.nearest()[i] <= depth && depth <= bounds.farthest()[i]) << absl::StrFormat(
          "seed %d: pixel %d, %d of %d x %d has depth %.9g, outside of [%.9g, %.9g]", seed,
          i % static_cast<std::size_t>(exact.width), i / static_cast<std::size_t>(exact.width),
          exact.width, exact.height, depth, bounds.nearest()[i], bounds.farthest()[i]);
      if (bounds.farthest()[i] < 1 || bounds.nearest()[i] > 0) {
        ++narrow_pixels_;
      }
    }
  }

  // Runs rounds of new seeds until the frames are drawn.
  template <typename Round>
  void RunRounds(std::int64_t bounded_frame_count, const Round& round) {
    const auto asked = EnvironmentNumber<std::int64_t>("ISOSCOPE_SOAK_FRAMES", 0);
    const std::int64_t frame_count = asked > 0 ? asked : bounded_frame_count;
    const std::uint64_t first_seed = FirstSeed(asked > 0);
    Watchdog watchdog;
    const base::MonotonicTime start = base::MonotonicNow();
    base::MonotonicTime next_progress = start + kProgressPeriod;
    const auto rate = [&] {
      return static_cast<double>(tally_.frames) /
             absl::ToDoubleSeconds(base::MonotonicNow() - start);
    };
    std::uint64_t seed = first_seed;
    for (; tally_.frames < frame_count; ++seed) {
      watchdog.BeginRound(seed);
      round(seed);
      if (HasFailure()) {
        FAIL() << "repeat it with ISOSCOPE_SOAK_FRAMES=1 ISOSCOPE_SOAK_SEED=" << seed;
      }
      if (base::MonotonicNow() >= next_progress) {
        std::cerr << absl::StrFormat("soak_test: %d frames, %.0f a second\n", tally_.frames,
                                     rate());
        next_progress = base::MonotonicNow() + kProgressPeriod;
      }
    }
    std::cout << absl::StrFormat(
        "soak_test: seeds %d to %d: %d frames, 0 differences, compared with %d references; %.0f s, "
        "%.0f frames a second\nsoak_test: %s\n",
        first_seed, seed - 1, tally_.frames, tally_.references,
        absl::ToDoubleSeconds(base::MonotonicNow() - start), rate(), tally_.ToString());
    if (tally_.frames < bounded_frame_count) {
      return;  // one round says nothing about the draws
    }
    // Defends the test: empty pictures would prove nothing, and each count must have its turn.
    EXPECT_GT(tally_.covered_pixels, 200 * tally_.references);
    EXPECT_GT(tally_.layer_pixels, 20 * tally_.references);
    EXPECT_GE(tally_.by_limit.size(), 5U);
  }

  std::unique_ptr<render::Renderer> renderer_;  // null: clusters make a CPU renderer
  std::int64_t covered_pixel_count_ = 0;
  std::int64_t culled_view_count_ = 0;
  Tally tally_;
  // Pixels that have bounds; of them those that are background by their bounds, and covered ones
  // whose bounds exclude some depth.
  std::int64_t bounded_pixels_ = 0;
  std::int64_t proved_background_ = 0;
  std::int64_t narrow_pixels_ = 0;
};

TEST_P(SoakTest, CulledPicturesOfAnyNumberOfAgentsAreTheWholePicture) {
  const auto seconds = EnvironmentNumber<double>("ISOSCOPE_SOAK_SECONDS", 0);
  const std::uint64_t seed = FirstSeed(seconds > 0);
  Watchdog watchdog;
  const base::MonotonicTime start = base::MonotonicNow();
  base::MonotonicTime next_progress = start + kProgressPeriod;
  int round = 0;
  for (; seconds > 0 ? base::MonotonicNow() - start < absl::Seconds(seconds) : round < kRoundCount;
       ++round) {
    watchdog.BeginRound(seed + static_cast<std::uint64_t>(round));
    RunRound(seed + static_cast<std::uint64_t>(round));
    if (HasFailure()) {
      FAIL() << "repeat it with ISOSCOPE_SOAK_SEED=" << seed + static_cast<std::uint64_t>(round);
    }
    if (base::MonotonicNow() >= next_progress) {
      std::cerr << "soak_test: " << round + 1 << " volumes\n";
      next_progress = base::MonotonicNow() + kProgressPeriod;
    }
  }
  // Defends the test: empty pictures and views where nothing is culled would prove nothing.
  EXPECT_GT(covered_pixel_count_, 500 * round);
  EXPECT_GT(culled_view_count_, round / 4);
}

TEST_P(SoakTest, NeitherThreadsNorLimitsNorOptionsNorCutsShowInSmallFrames) {
  RunRounds(kBoundedFrameCount, [this](std::uint64_t seed) { RunSmallRound(seed); });
  if (tally_.frames >= kBoundedFrameCount) {
    EXPECT_EQ(tally_.by_threads.size(), testing::kThreadCounts.size());
  }
}

// Labels have a rule of their own for blocks, keys, triangles and caps.
TEST_P(SoakTest, NeitherThreadsNorLimitsNorOptionsNorCutsShowInFramesOfLabels) {
  RunRounds(kBoundedFrameCount, [this](std::uint64_t seed) { RunLabelRound(seed); });
  std::cout << absl::StrFormat(
      "soak_test: the references have %d surfaces of labels; %d show another field\n",
      tally_.label_surfaces, tally_.colored_by_field);
  if (tally_.frames >= kBoundedFrameCount) {
    EXPECT_GT(tally_.label_surfaces, tally_.references);
    EXPECT_GT(tally_.colored_by_field, tally_.references / 10);
  }
}

TEST_P(SoakTest, FramesOfSeriesAreThoseOfTheirArraysAlone) {
  RunRounds(kBoundedSeriesFrameCount,
            [this](std::uint64_t seed) { RunSeriesRound(seed, /*has_levels=*/false); });
  std::cout << absl::StrFormat(
      "soak_test: of the references %d show another field, %d a magnitude\n",
      tally_.colored_by_field, tally_.magnitudes);
  if (tally_.frames >= kBoundedSeriesFrameCount) {
    EXPECT_GT(tally_.colored_by_field, tally_.references / 4);
    EXPECT_GT(tally_.magnitudes, 0);
  }
}

TEST_P(SoakTest, NeitherThreadsNorLimitsNorOptionsNorCutsShowInFramesOfLevels) {
  RunRounds(kBoundedLevelFrameCount, [this](std::uint64_t seed) { RunLevelRound(seed); });
  std::string levels;
  for (const auto& [level, count] : tally_.by_level) {
    absl::StrAppendFormat(&levels, "%s%d: %d", levels.empty() ? "" : ", ", level, count);
  }
  std::cout << absl::StrFormat(
      "soak_test: frames by level %s; of the references %d have effects; %d surfaces of labels\n",
      levels, tally_.with_effects, tally_.label_surfaces);
  if (tally_.frames >= kBoundedLevelFrameCount) {
    EXPECT_GE(tally_.by_level.size(), 3U);
    EXPECT_GT(tally_.with_effects, tally_.references / 5);
    EXPECT_GT(tally_.label_surfaces, 0);
  }
}

// One view of each volume. ISOSCOPE_SOAK_FRAMES is their number.
TEST_P(SoakTest, ExactDepthsLieBetweenTheirBounds) {
  const auto asked = EnvironmentNumber<std::int64_t>("ISOSCOPE_SOAK_FRAMES", 0);
  const std::int64_t count = asked > 0 ? asked : kBoundedBoundsCount;
  const std::uint64_t first_seed = FirstSeed(asked > 0);
  Watchdog watchdog;
  base::MonotonicTime next_progress = base::MonotonicNow() + kProgressPeriod;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto arena, testing::MakeOnlyArena(2));
  for (std::int64_t i = 0; i < count; ++i) {
    const std::uint64_t seed = first_seed + static_cast<std::uint64_t>(i);
    watchdog.BeginRound(seed);
    RunBoundsRound(seed, arena);
    if (HasFailure()) {
      FAIL() << "repeat it with ISOSCOPE_SOAK_FRAMES=1 ISOSCOPE_SOAK_SEED=" << seed;
    }
    if (base::MonotonicNow() >= next_progress) {
      std::cerr << "soak_test: " << i + 1 << " views\n";
      next_progress = base::MonotonicNow() + kProgressPeriod;
    }
  }
  std::cout << absl::StrFormat(
      "soak_test: seeds %d to %d: %d views, 0 depths outside of their bounds; of %d pixels %d "
      "covered, %d of "
      "these with bounds that exclude some depth; %d background by their bounds\n",
      first_seed, first_seed + static_cast<std::uint64_t>(count) - 1, count, bounded_pixels_,
      tally_.covered_pixels, narrow_pixels_, proved_background_);
  if (count >= kBoundedBoundsCount) {
    EXPECT_GT(tally_.covered_pixels, 200 * count);
    EXPECT_GT(narrow_pixels_, tally_.covered_pixels / 20);
    EXPECT_GT(proved_background_, 0);
  }
}

INSTANTIATE_TEST_SUITE_P(BackEnds, SoakTest,
                         ::testing::Values(render::RendererKind::kEgl, render::RendererKind::kCpu),
                         [](const auto& back_end) {
                           return back_end.param == render::RendererKind::kEgl ? "Egl" : "Cpu";
                         });

}  // namespace
}  // namespace isoscope
