// Adding levels to one volume:
//
//   1  StoredSamples reads its blocks back, portion by portion, and LevelSpool makes level 1
//   2  WriteLevels writes level_1, level_2, ... into each shard's folder; no manifest names them yet
//   3  the manifests of the shards, then that of the dataset, are replaced
//
// A process that is killed before step 3 leaves folders that no manifest names; after it, shards
// whose manifests name levels and others. The next one begins again where not all shards have them:
// it takes the names away first, then makes all levels of the volume anew. Dropping does the steps
// the other way round.
//
// A series does this for each volume; then the manifests of its shards and its own are replaced,
// which say how many levels each volume has. Appending is locked out meanwhile.
//
// Invariant: a manifest that names a level is written after the level.

#include "core/partition/dataset_levels.h"

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"
#include "core/io/atomic_file.h"
#include "core/io/file.h"
#include "core/partition/level_spool.h"
#include "core/partition/level_writer.h"
#include "core/partition/partition_plan.h"
#include "core/partition/series_work_folder.h"
#include "core/partition/stored_samples.h"
#include "core/partition/volume_writer.h"
#include "core/store/manifest.h"
#include "core/store/series_manifest.h"
#include "core/store/shard_levels.h"
#include "core/store/shard_reader.h"

namespace isoscope::partition {
namespace {

constexpr absl::string_view kLevelsFolderName = "levels.partial";
constexpr absl::string_view kLevelPrefix = "level_";

// Reads the manifest of a volume that is to be replaced.
absl::StatusOr<store::Manifest> ReadManifest(const std::string& directory) {
  const std::string path = absl::StrCat(directory, "/", store::kManifestFileName);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes,
                            io::ReadWholeFile(path, store::kMaxManifestBytes));
  ISOSCOPE_ASSIGN_OR_RETURN(store::Manifest manifest, store::DecodeManifest(bytes, path));
  if (store::EncodeManifest(manifest) != bytes) {
    return absl::FailedPreconditionError(absl::StrCat(
        path,
        ": has members that this program does not know, and would lose; use the program that "
        "wrote it, or a newer one"));
  }
  return manifest;
}

// Replaces the manifest of a directory by itself with other levels. Nothing happens if it has them.
absl::Status ReplaceLevels(const std::string& directory,
                           const std::vector<store::LevelSummary>& levels,
                           volume::LevelFilter filter) {
  ISOSCOPE_ASSIGN_OR_RETURN(store::Manifest manifest, ReadManifest(directory));
  if (manifest.levels == levels && manifest.level_filter == filter) {
    return absl::OkStatus();
  }
  manifest.levels = levels;
  manifest.level_filter = filter;
  ISOSCOPE_RETURN_IF_ERROR(io::WriteFileAtomically(
      absl::StrCat(directory, "/", store::kManifestFileName), store::EncodeManifest(manifest)));
  return io::SyncDirectory(directory);
}

absl::Status TakeLevelsAway(const std::string& directory) {
  return ReplaceLevels(directory, {}, volume::LevelFilter::kMean);
}

bool IsLevelFolder(const std::string& name) {
  int level = 0;
  return absl::StartsWith(name, kLevelPrefix) &&
         absl::SimpleAtoi(name.substr(kLevelPrefix.size()), &level);
}

// A manifest that a process which was killed did not finish.
bool IsPartialManifest(const std::string& name) {
  return absl::StartsWith(name, absl::StrCat(store::kManifestFileName, ".partial-")) ||
         absl::StartsWith(name, absl::StrCat(store::kSeriesShardFileName, ".partial-"));
}

// Takes the levels of a shard away, and what a process that was killed has left of some.
absl::Status ClearShard(const std::string& shard_directory) {
  ISOSCOPE_RETURN_IF_ERROR(TakeLevelsAway(shard_directory));
  ISOSCOPE_RETURN_IF_ERROR(RemoveEntries(shard_directory, IsPartialManifest));
  return RemoveEntries(shard_directory, IsLevelFolder);
}

// Makes the levels of volumes.
class LevelAdder {
 public:
  // work: the folder for all that is under way
  LevelAdder(const AddLevelsOptions& options, std::string work,
             const base::Cancellation& cancellation)
      : options_(options), work_(std::move(work)), cancellation_(cancellation) {}

  // Adds levels to a volume unless it has them, and returns its manifest, whose shards have it.
  // has_labels: its values have names
  absl::StatusOr<store::Manifest> Add(const std::vector<std::string>& shards, bool has_labels) {
    ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<StoredSamples> samples,
                              StoredSamples::Open(shards, options_.open_samples));
    store::Manifest manifest = samples->manifest();
    ISOSCOPE_ASSIGN_OR_RETURN(
        const LevelPlan levels,
        PlanLevels(options_.levels, manifest.geometry, manifest.scalar_type, manifest.block_cells,
                   static_cast<int>(manifest.shards.size()), has_labels));
    for (const std::string& shard : shards) {
      ISOSCOPE_RETURN_IF_ERROR(RemoveEntries(shard, IsPartialManifest));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const bool have_all, HaveAll(*samples));
    if (have_all) {
      ISOSCOPE_RETURN_IF_ERROR(CheckWanted(manifest, levels));
      return manifest;
    }
    for (const std::string& shard : shards) {
      ISOSCOPE_RETURN_IF_ERROR(ClearShard(shard));
    }
    manifest.levels.clear();
    manifest.level_filter = volume::LevelFilter::kMean;
    if (levels.highest == 0) {
      return manifest;
    }
    ISOSCOPE_RETURN_IF_ERROR(Make(shards, levels, std::move(samples), &manifest));
    for (const std::string& shard : shards) {
      ISOSCOPE_RETURN_IF_ERROR(ReplaceLevels(shard, manifest.levels, manifest.level_filter));
    }
    return manifest;
  }

 private:
  // Whether the manifests of all shards name the same levels, and these are there and whole, as far
  // as opening tells: blocks are not read. Errors that making levels anew can't mend are returned.
  static absl::StatusOr<bool> HaveAll(const StoredSamples& samples) {
    const store::Manifest& manifest = samples.manifest();
    for (const std::unique_ptr<store::ShardReader>& shard : samples.shards()) {
      if (shard->manifest() != manifest) {
        return false;
      }
      for (int level = 1; level <= manifest.highest_level(); ++level) {
        const absl::Status status = store::OpenLevelOf(*shard, level).status();
        if (absl::IsNotFound(status) || absl::IsDataLoss(status)) {
          return false;
        }
        ISOSCOPE_RETURN_IF_ERROR(status);
      }
    }
    return manifest.highest_level() > 0;
  }

  [[nodiscard]] absl::Status CheckWanted(const store::Manifest& manifest,
                                         const LevelPlan& levels) const {
    const bool has_filter =
        !options_.levels.filter.has_value() || manifest.level_filter == levels.filter;
    const bool has_levels = options_.levels.highest == LevelOptions::kAuto ||
                            manifest.highest_level() == levels.highest;
    if (has_filter && has_levels) {
      return absl::OkStatus();
    }
    return absl::AlreadyExistsError(absl::StrFormat(
        "dataset \"%s\" has levels 1 to %d by %s, and 1 to %d by %s are asked for: drop them first "
        "with `isoscope partition --drop-levels`",
        manifest.name, manifest.highest_level(), volume::NameOf(manifest.level_filter),
        levels.highest, volume::NameOf(levels.filter)));
  }

  // Steps 1 and 2.
  absl::Status Make(const std::vector<std::string>& shards, const LevelPlan& levels,
                    std::unique_ptr<StoredSamples> samples, store::Manifest* manifest) {
    PartitionOptions cut;
    cut.shard_count = static_cast<int>(manifest->shards.size());
    cut.block_cells = manifest->block_cells;
    cut.distribution = manifest->distribution;
    cut.seed = manifest->seed;
    cut.compression = options_.compression;
    cut.memory_limit_bytes = options_.memory_limit_bytes;
    cut.reserved_bytes = options_.reserved_bytes;
    const std::int64_t own_bytes = math::Volume(manifest->geometry.sample_dims) *
                                   static_cast<std::int64_t>(volume::SizeOf(manifest->scalar_type));
    const std::int64_t total_bytes =
        own_bytes + VolumeWriter::PassCount(cut) *
                        BytesOfLevels(levels, manifest->geometry, manifest->scalar_type);
    ISOSCOPE_RETURN_IF_ERROR(
        CheckLevelsFit(manifest->geometry, manifest->scalar_type, levels, cut));
    ISOSCOPE_ASSIGN_OR_RETURN(
        std::unique_ptr<LevelSpool> level1,
        CreateSpoolOfLevel1(work_, manifest->geometry, manifest->scalar_type, levels));
    ISOSCOPE_RETURN_IF_ERROR(Spool(*samples, own_bytes, total_bytes, level1.get()));
    samples.reset();
    if (options_.progress) {
      cut.progress = [&](PartitionProgress progress) {
        progress.done_bytes += own_bytes;
        progress.total_bytes = total_bytes;
        options_.progress(progress);
      };
    }
    ISOSCOPE_ASSIGN_OR_RETURN(manifest->levels, WriteLevels(*manifest, shards, work_, levels,
                                                            std::move(level1), cut, cancellation_));
    manifest->level_filter = levels.filter;
    return absl::OkStatus();
  }

  // Step 1.
  absl::Status Spool(StoredSamples& samples, std::int64_t own_bytes, std::int64_t total_bytes,
                     LevelSpool* level1) {
    const store::Manifest& manifest = samples.manifest();
    ISOSCOPE_ASSIGN_OR_RETURN(
        const PartitionPlan plan,
        PlanPartition(samples.layout(), manifest.scalar_type,
                      static_cast<int>(manifest.shards.size()), store::Distribution::kRandom,
                      options_.reserved_bytes +
                          (manifest.in_source.has_value() ? options_.source_bytes : 0) +
                          LevelSpool::MemoryBytes(level1->level()) +
                          StoredSamples::MemoryBytes(samples.layout(), manifest.scalar_type),
                      options_.memory_limit_bytes));
    const std::int64_t portions = PortionCount(samples.layout(), plan);
    std::int64_t done = 0;
    const auto visit = [&](const Slab& slab, const Portion& portion) -> absl::Status {
      ISOSCOPE_RETURN_IF_ERROR(level1->Add(samples.layout(), slab, portion));
      ++done;
      if (options_.progress) {
        options_.progress({.phase = "reading blocks",
                           .done_bytes = static_cast<std::int64_t>(static_cast<double>(own_bytes) *
                                                                   static_cast<double>(done) /
                                                                   static_cast<double>(portions)),
                           .total_bytes = total_bytes});
      }
      return absl::OkStatus();
    };
    return samples.ForEachPortion(plan, visit, cancellation_);
  }

  const AddLevelsOptions& options_;
  const std::string work_;
  const base::Cancellation& cancellation_;
};

// The shards of a dataset, all of them. NOT_FOUND otherwise.
absl::StatusOr<std::vector<std::string>> AllShards(const std::string& directory,
                                                   std::vector<std::string> shards) {
  for (std::size_t shard = 0; shard < shards.size(); ++shard) {
    if (shards[shard].empty()) {
      return absl::NotFoundError(absl::StrFormat(
          "%s: shard %d of %d is not there; add levels where all shards are, and copy them then",
          directory, shard, shards.size()));
    }
  }
  return shards;
}

absl::StatusOr<int> AddToVolume(const std::string& directory, const AddLevelsOptions& options,
                                const SeriesWorkFolder& folder,
                                const base::Cancellation& cancellation) {
  ISOSCOPE_ASSIGN_OR_RETURN(store::DatasetDescription dataset, store::OpenDataset(directory));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> shards,
                            AllShards(directory, std::move(dataset.shard_directories)));
  ISOSCOPE_RETURN_IF_ERROR(ReadManifest(directory).status());
  dataset.ranges = volume::RangeTable();  // the shards have their own
  LevelAdder adder(options, folder.path(), cancellation);
  ISOSCOPE_ASSIGN_OR_RETURN(const store::Manifest manifest,
                            adder.Add(shards, !dataset.manifest.labels.empty()));
  ISOSCOPE_RETURN_IF_ERROR(ReplaceLevels(directory, manifest.levels, manifest.level_filter));
  return manifest.highest_level();
}

// Replaces the manifests of the shards that are there, then that of the series, by one with the
// levels of `series`.
absl::Status ReplaceSeries(const std::string& directory, const store::SeriesDescription& series) {
  for (std::size_t shard = 0; shard < series.shard_directories.size(); ++shard) {
    if (!series.shard_directories[shard].empty()) {
      ISOSCOPE_RETURN_IF_ERROR(store::WriteSeriesManifest(
          series.shard_directories[shard], series.manifest, static_cast<int>(shard)));
    }
  }
  return store::WriteSeriesManifest(directory, series.manifest, -1);
}

std::vector<std::string> ShardsOfVolume(const std::vector<std::string>& shards,
                                        const store::ScalarVolumeKey& key) {
  std::vector<std::string> folders;
  for (const std::string& shard : shards) {
    if (!shard.empty()) {
      folders.push_back(absl::StrCat(shard, "/", store::ScalarVolumeDirectoryName(key)));
    }
  }
  return folders;
}

absl::StatusOr<int> AddToSeries(const std::string& directory, const AddLevelsOptions& options,
                                const SeriesWorkFolder& folder,
                                const base::Cancellation& cancellation) {
  ISOSCOPE_ASSIGN_OR_RETURN(store::SeriesDescription series, store::OpenSeries(directory));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> shards,
                            AllShards(directory, series.shard_directories));
  ISOSCOPE_RETURN_IF_ERROR(store::CheckComplete(series));
  const store::SeriesManifest before = series.manifest;
  AddLevelsOptions of_volume = options;
  std::string phase;
  std::size_t number = 0;
  if (options.progress) {
    // The share of one volume, as all have about as many bytes.
    of_volume.progress = [&](PartitionProgress progress) {
      phase = absl::StrCat("volume ", number, " of ", before.volumes.size());
      progress.phase = phase.c_str();
      progress.done_bytes += static_cast<std::int64_t>(number - 1) * progress.total_bytes;
      progress.total_bytes *= static_cast<std::int64_t>(before.volumes.size());
      options.progress(progress);
    };
  }
  LevelAdder adder(of_volume, folder.path(), cancellation);
  for (store::ScalarVolume& volume : series.manifest.volumes) {
    ++number;
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    ISOSCOPE_ASSIGN_OR_RETURN(
        const store::Manifest manifest,
        adder.Add(ShardsOfVolume(shards, volume.key), !series.manifest.labels.empty()));
    volume.highest_level = manifest.highest_level();
    volume.level_filter = manifest.level_filter;
  }
  if (!(series.manifest == before)) {
    ISOSCOPE_RETURN_IF_ERROR(ReplaceSeries(directory, series));
  }
  return series.manifest.highest_level();
}

absl::Status DropFromVolume(const std::vector<std::string>& shards,
                            const base::Cancellation& cancellation) {
  for (const std::string& shard : shards) {
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    if (!shard.empty() && io::PathExists(absl::StrCat(shard, "/", store::kManifestFileName))) {
      ISOSCOPE_RETURN_IF_ERROR(ClearShard(shard));
    }
  }
  return absl::OkStatus();
}

absl::Status DropFromSeries(const std::string& directory, const base::Cancellation& cancellation) {
  ISOSCOPE_ASSIGN_OR_RETURN(store::SeriesDescription series, store::OpenSeries(directory));
  const store::SeriesManifest before = series.manifest;
  for (store::ScalarVolume& volume : series.manifest.volumes) {
    volume.highest_level = 0;
    volume.level_filter = volume::LevelFilter::kMean;
  }
  if (!(series.manifest == before)) {
    ISOSCOPE_RETURN_IF_ERROR(ReplaceSeries(directory, series));
  }
  for (const store::ScalarVolume& volume : series.manifest.volumes) {
    ISOSCOPE_RETURN_IF_ERROR(
        DropFromVolume(ShardsOfVolume(series.shard_directories, volume.key), cancellation));
  }
  return absl::OkStatus();
}

// What writes to a dataset holds these, each for itself.
struct Locks {
  std::unique_ptr<SeriesWorkFolder> levels;
  std::unique_ptr<SeriesWorkFolder> append;  // of a series; null otherwise
};

absl::StatusOr<Locks> TakeLocks(const std::string& directory) {
  Locks locks;
  ISOSCOPE_ASSIGN_OR_RETURN(
      locks.levels, SeriesWorkFolder::Take(absl::StrCat(directory, "/", kLevelsFolderName)));
  ISOSCOPE_RETURN_IF_ERROR(locks.levels->Clear());
  if (store::IsSeriesDirectory(directory)) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        locks.append, SeriesWorkFolder::Take(absl::StrCat(directory, "/", kAppendFolderName)));
    if (io::PathExists(absl::StrCat(locks.append->path(), "/", store::kManifestFileName))) {
      return absl::FailedPreconditionError(
          absl::StrCat(directory, ": appending was interrupted at its end; do it again first"));
    }
  }
  ISOSCOPE_RETURN_IF_ERROR(RemoveEntries(directory, IsPartialManifest));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> shards,
                            store::ShardDirectoriesOf(directory));
  for (const std::string& shard : shards) {
    if (!shard.empty()) {
      ISOSCOPE_RETURN_IF_ERROR(RemoveEntries(shard, IsPartialManifest));
    }
  }
  return locks;
}

absl::Status CheckIsDataset(const std::string& directory) {
  if (store::IsDatasetDirectory(directory)) {
    return absl::OkStatus();
  }
  // The error that opening it has.
  return store::OpenDataset(directory).status();
}

}  // namespace

absl::StatusOr<int> AddLevels(const std::string& directory, const AddLevelsOptions& options,
                              const base::Cancellation& cancellation) {
  ISOSCOPE_RETURN_IF_ERROR(CheckIsDataset(directory));
  ISOSCOPE_ASSIGN_OR_RETURN(const Locks locks, TakeLocks(directory));
  return locks.append == nullptr ? AddToVolume(directory, options, *locks.levels, cancellation)
                                 : AddToSeries(directory, options, *locks.levels, cancellation);
}

absl::Status DropLevels(const std::string& directory, const base::Cancellation& cancellation) {
  ISOSCOPE_RETURN_IF_ERROR(CheckIsDataset(directory));
  ISOSCOPE_ASSIGN_OR_RETURN(const Locks locks, TakeLocks(directory));
  if (locks.append != nullptr) {
    return DropFromSeries(directory, cancellation);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const store::DatasetDescription dataset, store::OpenDataset(directory));
  ISOSCOPE_RETURN_IF_ERROR(TakeLevelsAway(directory));
  return DropFromVolume(dataset.shard_directories, cancellation);
}

}  // namespace isoscope::partition
