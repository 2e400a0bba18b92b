// From the root of the checksums down, as whoever opens a dataset does
// (core/store/shard_reader.cc), but to the last byte:
//
//   dataset: manifest.json; of version 1: ranges.bin
//   each shard of a series: manifest.json, series_shard.json
//   each shard of each volume: ShardReader::Open verifies manifest.json, ranges.bin, shard.json,
//   block_index.bin and the head of interval_tree.bin; then all blocks, the histogram, and all
//   pages of the tree
//   each level of each of these shards: the same, and that the manifest of level 0 names it
//
// The blocks of an index-only dataset are read from its source; what has changed there is damage.
// A disk run with a damaged block is read again block by block, so that each damaged one is told.
// A directory without a readable manifest does not hide its shards: they are found by their names.

#include "core/partition/dataset_verifier.h"

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <numeric>
#include <optional>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/types/span.h"

#include "core/base/error_reason.h"
#include "core/base/status_macros.h"
#include "core/index/interval_tree.h"
#include "core/io/file.h"
#include "core/io/page_file.h"
#include "core/store/sealed_json.h"
#include "core/store/series_manifest.h"
#include "core/store/shard_format.h"
#include "core/store/shard_levels.h"
#include "core/store/shard_reader.h"

namespace isoscope::partition {
namespace {

namespace fs = std::filesystem;

// The shard directories of a dataset whose manifest can't be read, by name.
std::vector<std::string> FindShards(const std::string& directory) {
  std::vector<std::string> shards;
  std::error_code error;
  for (fs::directory_iterator entry(directory, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code ignored;
    if (absl::StartsWith(entry->path().filename().string(), "shard-") &&
        entry->is_directory(ignored)) {
      shards.push_back(entry->path().string());
    }
  }
  std::sort(shards.begin(), shards.end());
  return shards;
}

// The CRC-32C by which others name a manifest that was decoded; the seal, of a series.
absl::StatusOr<std::uint32_t> SealOf(const std::string& directory) {
  const std::string path = absl::StrCat(directory, "/", store::kManifestFileName);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes,
                            io::ReadWholeFile(path, store::kMaxSeriesManifestBytes));
  return store::IsSeriesDirectory(directory) ? store::VerifySeal(bytes, path)
                                             : store::ManifestCrc32c(bytes, path);
}

class Verifier {
 public:
  Verifier(const VerifyOptions& options, const base::Cancellation& cancellation)
      : options_(options), cancellation_(cancellation) {}

  absl::StatusOr<VerifyReport> Run(const std::string& directory) {
    report_.file_bytes = io::BytesBelow(directory);
    Advance(0);
    absl::Status status;
    if (store::IsShardDirectory(directory)) {
      status = store::IsSeriesDirectory(directory) ? VerifySeriesShardAlone(directory)
                                                   : VerifyShardAlone(directory);
    } else {
      status =
          store::IsSeriesDirectory(directory) ? VerifySeries(directory) : VerifyVolume(directory);
    }
    ISOSCOPE_RETURN_IF_ERROR(status);
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    return report_;
  }

 private:
  void Damage(absl::string_view message) {
    ++report_.damage_count;
    if (options_.damage) {
      options_.damage(std::string(message));
    }
  }
  // Tells an error that is damage, and returns whether there was one.
  bool IsDamaged(const absl::Status& status) {
    if (!status.ok()) {
      Damage(status.message());
    }
    return !status.ok();
  }
  // Returns the error of a source that can't be read, which is no damage; else OK.
  static absl::Status OfUnreadableSource(const absl::Status& status) {
    return !status.ok() && base::ReasonOf(status) == base::ErrorReason::kSourceUnreadable
               ? status
               : absl::OkStatus();
  }
  void Advance(std::int64_t bytes) {
    done_bytes_ += bytes;
    if (options_.progress && report_.file_bytes > 0) {
      options_.progress(std::min(done_bytes_, report_.file_bytes), report_.file_bytes);
    }
  }

  // Verifies a dataset of version 1. A folder that is no dataset, or one of a newer version, is an
  // error and no damage.
  absl::Status VerifyVolume(const std::string& directory) {
    const absl::StatusOr<store::DatasetDescription> dataset = store::OpenDataset(directory);
    if (absl::IsNotFound(dataset.status()) || absl::IsFailedPrecondition(dataset.status())) {
      return dataset.status();
    }
    if (IsDamaged(dataset.status())) {
      return VerifyFoundShards(directory);
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const std::uint32_t seal, SealOf(directory));
    report_.volume_count = 1;
    for (const std::string& shard : dataset->shard_directories) {
      if (shard.empty()) {
        ++report_.missing_shard_count;
        continue;
      }
      ++report_.shard_count;
      ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<store::ShardReader> reader,
                                VerifyShard(shard, seal));
      if (reader != nullptr &&
          (reader->manifest().levels != dataset->manifest.levels ||
           reader->manifest().level_filter != dataset->manifest.level_filter)) {
        Damage(absl::StrFormat(
            "%s/%s: names %d levels, the dataset's manifest %d or others: run `isoscope partition "
            "--add-levels` or --drop-levels again, or copy the newer manifest",
            shard, store::kManifestFileName, reader->manifest().highest_level(),
            dataset->manifest.highest_level()));
      }
    }
    return absl::OkStatus();
  }

  // The shards of a dataset whose own manifest can't be read.
  absl::Status VerifyFoundShards(const std::string& directory) {
    for (const std::string& shard : FindShards(directory)) {
      ISOSCOPE_RETURN_IF_ERROR(store::IsSeriesDirectory(shard) ? VerifySeriesShardAlone(shard)
                                                               : VerifyShardAlone(shard));
    }
    return absl::OkStatus();
  }

  absl::Status VerifyShardAlone(const std::string& directory) {
    report_.volume_count = 1;
    ++report_.shard_count;
    return VerifyShard(directory, std::nullopt).status();
  }

  absl::Status VerifySeries(const std::string& directory) {
    const absl::StatusOr<store::SeriesDescription> series = store::OpenSeries(directory);
    if (absl::IsNotFound(series.status()) || absl::IsFailedPrecondition(series.status())) {
      return series.status();
    }
    if (IsDamaged(series.status())) {
      return VerifyFoundShards(directory);
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const std::uint32_t seal, SealOf(directory));
    report_.volume_count = static_cast<std::int64_t>(series->manifest.volumes.size());
    for (std::size_t i = 0; i < series->shard_directories.size(); ++i) {
      const std::string& path = series->shard_directories[i];
      if (path.empty()) {
        ++report_.missing_shard_count;
        continue;
      }
      ++report_.shard_count;
      const absl::StatusOr<store::SeriesShard> shard = store::OpenSeriesShard(path);
      if (!IsDamaged(shard.status()) &&
          (shard->manifest_crc32c != seal || shard->shard_index != static_cast<int>(i))) {
        Damage(absl::StrFormat(
            "%s/%s: shard %d with crc32c 0x%08x; the dataset's is 0x%08x: one of them is older; "
            "copy "
            "the newer one",
            path, store::kManifestFileName, shard->shard_index, shard->manifest_crc32c, seal));
      }
      ISOSCOPE_RETURN_IF_ERROR(VerifyVolumesOfShard(path, static_cast<int>(i), series->manifest));
    }
    return absl::OkStatus();
  }

  absl::Status VerifySeriesShardAlone(const std::string& directory) {
    const absl::StatusOr<store::SeriesShard> shard = store::OpenSeriesShard(directory);
    ++report_.shard_count;
    if (IsDamaged(shard.status())) {
      return absl::OkStatus();
    }
    report_.volume_count = static_cast<std::int64_t>(shard->manifest.volumes.size());
    return VerifyVolumesOfShard(directory, shard->shard_index, shard->manifest);
  }

  // All scalar volumes that the manifest names, in one shard of a series.
  absl::Status VerifyVolumesOfShard(const std::string& directory, int shard_index,
                                    const store::SeriesManifest& series) {
    for (const store::ScalarVolume& volume : series.volumes) {
      const std::string path =
          absl::StrCat(directory, "/", store::ScalarVolumeDirectoryName(volume.key));
      if (!io::IsDirectory(path)) {
        Damage(absl::StrCat(path, ": is missing; copy the shard again"));
        continue;
      }
      ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<store::ShardReader> reader,
                                VerifyShard(path, volume.manifest_crc32c));
      if (reader != nullptr && !IsOfSeries(*reader, shard_index, volume, series)) {
        Damage(
            absl::StrFormat("%s: shard %d of dataset %s: does not belong to this series, shard "
                            "%d of %d; files are mixed",
                            path, reader->shard_index(), reader->manifest().dataset_id, shard_index,
                            series.shard_count));
      }
      if (reader != nullptr && reader->manifest().highest_level() != volume.highest_level) {
        Damage(absl::StrFormat(
            "%s/%s: names %d levels, the manifest of the series %d: run `isoscope partition "
            "--add-levels` or --drop-levels again, or copy the newer manifest",
            path, store::kManifestFileName, reader->manifest().highest_level(),
            volume.highest_level));
      }
    }
    return absl::OkStatus();
  }

  static bool IsOfSeries(const store::ShardReader& reader, int shard_index,
                         const store::ScalarVolume& volume, const store::SeriesManifest& series) {
    const store::Manifest& manifest = reader.manifest();
    const store::FieldComponent& component =
        series.fields[static_cast<std::size_t>(volume.key.field)]
            .components[static_cast<std::size_t>(volume.key.component)];
    return reader.shard_index() == shard_index && manifest.dataset_id == volume.dataset_id &&
           manifest.shards.size() == static_cast<std::size_t>(series.shard_count) &&
           manifest.geometry == series.geometry && manifest.block_cells == series.block_cells &&
           manifest.distribution == store::Distribution::kRandom && manifest.seed == series.seed &&
           manifest.scalar_type == component.scalar_type &&
           manifest.value_range == volume.value_range &&
           manifest.finite_range == volume.finite_range &&
           manifest.max_gradient_magnitude == volume.max_gradient_magnitude;
  }

  // Returns the open shard; null if it can't be opened. Other errors than damage are returned.
  absl::StatusOr<std::unique_ptr<store::ShardReader>> VerifyShard(
      const std::string& directory, std::optional<std::uint32_t> manifest_crc32c) {
    const std::int64_t end = done_bytes_ + io::BytesBelow(directory);
    absl::StatusOr<std::unique_ptr<store::ShardReader>> reader =
        store::ShardReader::Open(directory, io::OpenRandomAccessFile, options_.open_samples);
    ISOSCOPE_RETURN_IF_ERROR(OfUnreadableSource(reader.status()));
    std::unique_ptr<store::ShardReader> opened;
    if (!IsDamaged(reader.status())) {
      opened = *std::move(reader);
      if (manifest_crc32c.has_value() && opened->manifest_crc32c() != *manifest_crc32c) {
        Damage(absl::StrFormat(
            "%s/%s: crc32c 0x%08x, the dataset's manifest expects 0x%08x: it is of another dataset",
            directory, store::kManifestFileName, opened->manifest_crc32c(), *manifest_crc32c));
      }
      ISOSCOPE_RETURN_IF_ERROR(VerifyFiles(*opened));
      ISOSCOPE_RETURN_IF_ERROR(VerifyLevels(*opened));
    }
    Advance(end - done_bytes_);
    return opened;
  }

  // What opening has not verified.
  absl::Status VerifyFiles(const store::ShardReader& reader) {
    report_.block_count += reader.block_count();
    ISOSCOPE_RETURN_IF_ERROR(VerifyBlocks(reader));
    IsDamaged(reader.ReadHistogram().status());
    IsDamaged(reader.VerifySpans());
    return VerifyTree(absl::StrCat(reader.directory(), "/", store::kIntervalTreeFileName), reader);
  }

  // The levels of a shard whose level 0 is open.
  absl::Status VerifyLevels(const store::ShardReader& shard) {
    for (int level = 1; level <= shard.manifest().highest_level(); ++level) {
      const absl::StatusOr<std::unique_ptr<store::ShardReader>> reader =
          store::OpenLevelOf(shard, level);
      if (!IsDamaged(reader.status())) {
        ISOSCOPE_RETURN_IF_ERROR(VerifyFiles(**reader));
      }
    }
    return absl::OkStatus();
  }

  absl::Status VerifyBlocks(const store::ShardReader& reader) {
    std::vector<std::uint32_t> ordinals(static_cast<std::size_t>(reader.block_count()));
    std::iota(ordinals.begin(), ordinals.end(), std::uint32_t{0});
    const auto accept = [](const volume::BlockSamples&) { return absl::OkStatus(); };
    std::string buffer;
    for (const store::ShardReader::DiskRun& run : reader.PlanDiskRuns(ordinals)) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
      buffer.resize(std::max(buffer.size(), static_cast<std::size_t>(run.size)));
      if (!reader.ReadDiskRun(run, ordinals, buffer.data(), accept).ok()) {
        for (std::size_t i = run.first; i < run.first + run.count; ++i) {
          const absl::Span<const std::uint32_t> one = absl::MakeConstSpan(ordinals).subspan(i, 1);
          for (const store::ShardReader::DiskRun& block : reader.PlanDiskRuns(one)) {
            const absl::Status status = reader.ReadDiskRun(block, one, buffer.data(), accept);
            ISOSCOPE_RETURN_IF_ERROR(OfUnreadableSource(status));
            IsDamaged(status);
          }
        }
      }
      Advance(run.size);
    }
    return absl::OkStatus();
  }

  absl::Status VerifyTree(const std::string& path, const store::ShardReader& reader) {
    constexpr std::int64_t kPagesBetweenChecks = 1024;
    absl::StatusOr<std::unique_ptr<io::RandomAccessFile>> file = io::OpenRandomAccessFile(path);
    if (IsDamaged(file.status())) {
      return absl::OkStatus();
    }
    absl::StatusOr<std::unique_ptr<io::PageFile>> pages = io::PageFile::Open(*std::move(file), 0);
    if (IsDamaged(pages.status())) {
      return absl::OkStatus();
    }
    for (std::int64_t page = 0; page < (*pages)->page_count(); ++page) {
      if (page % kPagesBetweenChecks == 0) {
        ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
      }
      io::PageReadCost cost;
      IsDamaged((*pages)->Read(static_cast<io::PageNumber>(page), &cost).status());
      Advance(static_cast<std::int64_t>(io::kPageBytes));
    }
    absl::StatusOr<std::unique_ptr<io::RandomAccessFile>> again = io::OpenRandomAccessFile(path);
    if (IsDamaged(again.status())) {
      return absl::OkStatus();
    }
    const absl::StatusOr<std::unique_ptr<index::IntervalTree>> tree =
        index::IntervalTree::Open(*std::move(again), 0);
    if (!IsDamaged(tree.status()) && (*tree)->interval_count() > reader.block_count()) {
      Damage(absl::StrFormat("%s: %d intervals for %d blocks: it is of another shard", path,
                             (*tree)->interval_count(), reader.block_count()));
    }
    return absl::OkStatus();
  }

  const VerifyOptions& options_;
  const base::Cancellation& cancellation_;
  VerifyReport report_;
  std::int64_t done_bytes_ = 0;
};

}  // namespace

absl::StatusOr<VerifyReport> VerifyDataset(const std::string& directory,
                                           const VerifyOptions& options,
                                           const base::Cancellation& cancellation) {
  return Verifier(options, cancellation).Run(directory);
}

}  // namespace isoscope::partition
