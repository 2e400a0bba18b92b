// Frames of an index-only dataset are those of the copied one, byte for byte: for any source, shards,
// cut, threads and limits.

#include <array>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/base/status_macros.h"
#include "core/image/png_codec.h"
#include "tests/support/draws.h"
#include "tests/support/hdf5_volume_file.h"
#include "tests/support/local_cluster.h"
#include "tests/support/random_options.h"
#include "tests/support/scenes.h"
#include "tests/support/status_matchers.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/core/indexed/indexed_fixture.h"

namespace isoscope {
namespace {

using testing::Cut;
using testing::Dice;
using testing::LocalCluster;

// Each of two clusters draws this many frames of each dataset.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr int kFrames = 6;
#else
constexpr int kFrames = 40;
#endif
constexpr int kDatasets = 8;

// ISOSCOPE_INDEX_ONLY_DATASETS: for a long run.
int DatasetCount() {
  // NOLINTNEXTLINE(concurrency-mt-unsafe): no thread changes the environment
  const char* const text = std::getenv("ISOSCOPE_INDEX_ONLY_DATASETS");
  int count = kDatasets;
  return text != nullptr && absl::SimpleAtoi(text, &count) ? count : kDatasets;
}

struct Source {
  source::OpenRequest request;
  double isovalue = 0;
};

// An HDF5 file of any layout, in either byte order.
void WriteHdf5(Dice* dice, const std::string& path, const math::Index3& dims,
               const std::string& samples) {
  testing::Hdf5VolumeFile volume{.dims = dims,
                                 .file_type = dice->OneIn(2) ? H5T_STD_U16BE : H5T_STD_U16LE};
  if (!dice->OneIn(4)) {
    volume.chunk = {dice->Whole(3, 20), dice->Whole(3, 20), dice->Whole(3, 20)};
    volume.has_scale_offset = dice->OneIn(6);
    volume.has_shuffle = dice->OneIn(2);
    volume.has_gzip = dice->OneIn(2);
    volume.has_checksum = dice->OneIn(3);
    volume.is_latest = dice->OneIn(2);
    volume.has_plain_edges = volume.is_latest && dice->OneIn(2);
    volume.skipped_every = volume.has_scale_offset ? 0 : static_cast<int>(dice->Whole(0, 3));
    volume.missing_every = dice->OneIn(3) ? 5 : 0;
    volume.fill = dice->OneIn(2) ? std::string("\x30\x75") : "";  // 30000
  }
  testing::WriteHdf5Volume(path, volume, samples);
}

// A raw file, a VTK image, HDF5, or a Zarr array in chunks of any size; cropped, or with a stride, now and then.
Source WriteSource(Dice* dice, const std::string& path) {
  const math::Index3 dims{dice->Whole(20, 60), dice->Whole(20, 50), dice->Whole(20, 50)};
  const bool is_noise = dice->OneIn(3);
  const std::string samples =
      is_noise ? testing::SampleNoise(dice->Bits(), dims, volume::ScalarType::kUint16, 4)
               : testing::SampleField(testing::RandomField(dice->Bits(), 30, 8), dims,
                                      volume::ScalarType::kUint16, 10000, 30000);
  Source source{.request = {.path = path}, .isovalue = is_noise ? 2.0 : 30300.0};
  if (dice->OneIn(3)) {
    source.request.path += ".h5";
    WriteHdf5(dice, source.request.path, dims, samples);
  } else if (dice->OneIn(3)) {
    testing::WriteFile(path, samples);
    source.request.raw = {.dims = dims, .type = volume::ScalarType::kUint16};
  } else if (dice->OneIn(4)) {
    source.request.path = path + ".vti";
    testing::WriteVti(source.request.path, dims, "UInt16", 1,
                      dice->OneIn(2) ? 0 : static_cast<std::size_t>(dice->Whole(100, 40000)),
                      samples);
  } else {
    testing::WriteZarr(path, dims, "<u2", 2,
                       {dice->Whole(3, 40), dice->Whole(3, 40), dice->Whole(3, 40)}, samples);
  }
  if (dice->OneIn(3)) {
    source.request.crop = {.begin = {1, 2, 3}, .end = dims - math::Index3{2, 0, 1}};
  }
  source.request.stride = dice->OneIn(4) ? 2 : 1;
  return source;
}

frame::FrameSpec SpecOf(std::uint64_t seed, const store::Manifest& manifest, double isovalue) {
  const math::Box3d bounds = manifest.geometry.Bounds();
  frame::FrameSpec spec = testing::RandomSpec(seed, bounds, isovalue);
  if (seed % 3 == 0) {
    spec.surfaces = testing::ThreeSurfaces(isovalue, 1);
  }
  if (seed % 2 == 0) {
    spec.clip = testing::RandomClip(seed, bounds);
    testing::AddRandomCaps(seed, &spec);
  }
  if (seed % 5 == 0) {
    testing::MakeRandomlyTranslucent(seed, &spec);
  }
  return spec;
}

// The PNGs of all frames, with random threads and limits and a cache that may keep nothing.
absl::StatusOr<std::vector<std::string>> Draw(LocalCluster* cluster, Dice* dice, std::uint64_t seed,
                                              double isovalue) {
  ISOSCOPE_RETURN_IF_ERROR(cluster->Wake(testing::DrawLimits(dice)));
  const store::Manifest& manifest = cluster->manifest();
  ISOSCOPE_ASSIGN_OR_RETURN(
      const volume::BlockLayout layout,
      volume::BlockLayout::Make(manifest.geometry.sample_dims, manifest.block_cells));
  std::vector<std::string> pictures;
  for (int i = 0; i < kFrames; ++i) {
    if (i % 10 == 0) {
      cluster->ForgetAll(dice->OneIn(2) ? LocalCluster::kAmpleCacheBytes : 0);
    }
    const frame::FrameSpec spec = SpecOf(seed + static_cast<std::uint64_t>(i), manifest, isovalue);
    ISOSCOPE_ASSIGN_OR_RETURN(server::FrameResult result, cluster->Render(spec));
    ISOSCOPE_ASSIGN_OR_RETURN(
        const testing::Picture picture,
        testing::PictureOf(std::move(result), spec, layout, manifest.geometry));
    const image::FrameImage& image = picture.image;
    pictures.push_back(image::EncodePng(image.width, image.height, image.colors));
  }
  cluster->Sleep();
  return pictures;
}

TEST(IndexOnlyTest, FramesAreThoseOfTheCopiedDataset) {
  std::size_t different_pictures = 0;
  for (int i = 0; i < DatasetCount(); ++i) {
    Dice dice(testing::DrawSeed(absl::StrCat(i)));
    const testing::TempDir dir;
    const Source source = WriteSource(&dice, dir.Sub("volume"));
    partition::PartitionOptions options;
    const std::int64_t edge = dice.Whole(3, 17);
    options.block_cells = {edge, dice.Whole(3, 17), edge};
    options.levels.highest = 0;
    options.shard_count = static_cast<int>(dice.Whole(1, 4));
    options.seed = dice.Bits();
    options.output_directory = dir.Sub("copied");
    auto copied_cut = Cut(source.request, options, false);
    if (absl::IsInvalidArgument(copied_cut.status())) {  // fewer blocks than shards
      options.shard_count = 1;
      copied_cut = Cut(source.request, options, false);
    }
    ISOSCOPE_ASSERT_OK(copied_cut.status());
    options.output_directory = dir.Sub("index_only");
    auto indexed = Cut(source.request, options, true);
    if (absl::IsInvalidArgument(indexed.status())) {  // fewer chunks than shards
      options.shard_count = 1;
      indexed = Cut(source.request, options, true);
    }
    ISOSCOPE_ASSERT_OK(indexed.status());
    const store::OpenSamples open_samples = indexed::MakeSampleOpener(
        {.allows_local_files = true,
         // Few units are kept; with a stride more is decoded for each.
         .max_bytes =
             source.request.stride > 1 ? indexed::kDefaultSourceBytes : std::size_t{2} << 20});
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto copied,
                                  LocalCluster::OpenAsleep(dir.Sub("copied"), nullptr));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto index_only,
        LocalCluster::OpenAsleep(dir.Sub("index_only"), nullptr, open_samples));
    const std::uint64_t seed = dice.Bits() >> 8;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto expected,
                                  Draw(copied.get(), &dice, seed, source.isovalue));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto found,
                                  Draw(index_only.get(), &dice, seed, source.isovalue));
    for (std::size_t frame = 0; frame < expected.size(); ++frame) {
      ASSERT_EQ(found[frame], expected[frame]) << "dataset " << i << ", frame " << frame;
      different_pictures += frame > 0 && expected[frame] != expected[frame - 1] ? 1U : 0U;
    }
  }
  EXPECT_GT(different_pictures, static_cast<std::size_t>(DatasetCount()));
}

// A frame of any volume, colored by another one at its step now and then.
absl::StatusOr<std::vector<std::string>> DrawSeries(LocalCluster* cluster, Dice* dice,
                                                    std::uint64_t seed,
                                                    const store::SeriesManifest& series,
                                                    double isovalue) {
  ISOSCOPE_RETURN_IF_ERROR(cluster->Wake(testing::DrawLimits(dice)));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const volume::BlockLayout layout,
      volume::BlockLayout::Make(series.geometry.sample_dims, series.block_cells));
  const math::Box3d bounds = series.geometry.Bounds();
  std::vector<std::string> pictures;
  for (int i = 0; i < kFrames; ++i) {
    if (i % 10 == 0) {
      cluster->ForgetAll(dice->OneIn(2) ? LocalCluster::kAmpleCacheBytes : 0);
    }
    const std::uint64_t frame_seed = seed + static_cast<std::uint64_t>(i);
    frame::FrameSpec spec = testing::RandomSpec(frame_seed, bounds, isovalue);
    const store::ScalarVolume& volume = series.volumes[frame_seed % series.volumes.size()];
    if (frame_seed % 3 == 0) {
      const store::ScalarVolumeKey& other =
          series.volumes[frame_seed / 3 % series.volumes.size()].key;
      cluster->AddField("other", other.field, other.component);
      spec.surfaces.front().color_by = frame::ColorBy{.quantity = frame::ColorBy::Quantity::kField,
                                                      .range = frame::ColorRange{0, 100},
                                                      .field = "other"};
    }
    ISOSCOPE_ASSIGN_OR_RETURN(server::FrameResult result, cluster->Render(spec, volume.key));
    ISOSCOPE_ASSIGN_OR_RETURN(const testing::Picture picture,
                              testing::PictureOf(std::move(result), spec, layout, series.geometry));
    const image::FrameImage& image = picture.image;
    pictures.push_back(image::EncodePng(image.width, image.height, image.colors));
  }
  cluster->Sleep();
  return pictures;
}

TEST(IndexOnlyTest, FramesOfASeriesAreThoseOfTheCopiedSeries) {
  std::size_t different_pictures = 0;
  for (int i = 0; i < DatasetCount(); ++i) {
    Dice dice(testing::DrawSeed(absl::StrCat("series", i)));
    const testing::TempDir dir;
    const source::OpenRequest request = testing::WriteSeries(dir.Sub("s.zarr"), &dice);
    partition::PartitionOptions options;
    options.block_cells = {dice.Whole(3, 17), dice.Whole(3, 17), dice.Whole(3, 17)};
    options.levels.highest = 0;
    options.shard_count = static_cast<int>(dice.Whole(1, 3));
    options.seed = dice.Bits();
    options.output_directory = dir.Sub("index_only");
    auto indexed = testing::CutSeries(request, options, true);
    if (absl::IsInvalidArgument(indexed.status())) {  // fewer chunks or blocks than shards
      options.shard_count = 1;
      indexed = testing::CutSeries(request, options, true);
    }
    ISOSCOPE_ASSERT_OK(indexed.status());
    options.output_directory = dir.Sub("copied");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const store::SeriesManifest series,
                                  testing::CutSeries(request, options, false));
    const store::OpenSamples open_samples = indexed::MakeSampleOpener({.allows_local_files = true});
    // Now and then each volume is opened anew.
    const std::size_t open_bytes = dice.OneIn(2) ? 1 : LocalCluster::kAmpleCacheBytes;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto copied, LocalCluster::OpenSeriesAsleep(dir.Sub("copied"), nullptr, open_bytes));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto index_only,
        LocalCluster::OpenSeriesAsleep(dir.Sub("index_only"), nullptr, open_bytes, open_samples));
    const std::uint64_t seed = dice.Bits() >> 8;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto expected,
                                  DrawSeries(copied.get(), &dice, seed, series, 97.5));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto found,
                                  DrawSeries(index_only.get(), &dice, seed, series, 97.5));
    for (std::size_t frame = 0; frame < expected.size(); ++frame) {
      ASSERT_EQ(found[frame], expected[frame]) << "dataset " << i << ", frame " << frame;
      different_pictures += frame > 0 && expected[frame] != expected[frame - 1] ? 1U : 0U;
    }
  }
  EXPECT_GT(different_pictures, static_cast<std::size_t>(DatasetCount()));
}

}  // namespace
}  // namespace isoscope
