// A new series:
//
//   1  the plan (series_plan.h)
//   2  WriteVolumes, in "<output>.partial" (series_work_folder.h)
//   3  manifests of the shards, then of the dataset
//   4  "<output>.partial" gets its name
//
// Appending to `flow` does the same in flow/append.partial, up to step 2. Then:
//
//   3  append.partial/manifest.json: from here on what was appended is part of the series, whoever
//      finishes the rest
//   4  the new folders move from append.partial/shard-... to flow/shard-...
//   5  manifests of the shards, then of the dataset, each replaced in one step
//   6  append.partial is removed
//
// A process that is killed before step 3 leaves a folder that the next one removes, or goes on with
// if it resumes. After step 3 the next one does steps 4 to 6 before anything else: each of them may
// be done twice.

#include "core/partition/series_partitioner.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/sha256.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/partition/output_folder.h"
#include "core/partition/series_plan.h"
#include "core/partition/series_work_folder.h"
#include "core/partition/series_writer.h"
#include "core/store/shard_format.h"
#include "core/store/shard_reader.h"
#include "core/store/source_volume.h"

namespace isoscope::partition {
namespace {

// Memory of one scalar volume in the manifest and its JSON, while it is written.
constexpr std::int64_t kManifestBytesPerVolume = 2 * base::kKiB;

std::string TrimmedPath(std::string path) {
  while (path.size() > 1 && path.back() == '/') {
    path.pop_back();
  }
  return path;
}

std::vector<store::ScalarVolumeKey> KeysOf(const std::vector<VolumeTask>& tasks) {
  std::vector<store::ScalarVolumeKey> keys;
  keys.reserve(tasks.size());
  for (const VolumeTask& task : tasks) {
    keys.push_back(task.key);
  }
  return keys;
}

// A run that does not resume clears what an interrupted run left.
absl::Status PrepareFolder(bool resumes, int shard_count, SeriesWorkFolder* folder) {
  if (!resumes) {
    ISOSCOPE_RETURN_IF_ERROR(folder->Clear());
  }
  return folder->Prepare(shard_count);
}

PartitionOptions WithManifestMemory(PartitionOptions options, std::size_t volume_count) {
  options.reserved_bytes += static_cast<std::int64_t>(volume_count) * kManifestBytesPerVolume;
  return options;
}

// Appended volumes get the levels of those before.
PartitionOptions WithLevelsOf(const store::SeriesManifest& series, PartitionOptions options) {
  options.levels = {.highest = series.highest_level()};
  return options;
}

// Steps 4 and 5 of appending.
absl::Status MoveIntoSeries(const std::string& directory, const SeriesWorkFolder& folder,
                            const store::SeriesManifest& before,
                            const store::SeriesManifest& after) {
  for (int shard = 0; shard < after.shard_count; ++shard) {
    const std::string shard_name = store::ShardDirectoryName(shard, after.shard_count);
    for (const store::ScalarVolume& volume : after.volumes) {
      const std::string name =
          absl::StrCat("/", shard_name, "/", store::ScalarVolumeDirectoryName(volume.key));
      if (before.Find(volume.key) == nullptr && io::IsDirectory(folder.path() + name)) {
        ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(directory + name));
        ISOSCOPE_RETURN_IF_ERROR(io::RenamePath(folder.path() + name, directory + name));
      }
    }
  }
  return WriteSeriesManifests(directory, after);
}

// True if `after` is `before` and what was appended to it.
bool Continues(const store::SeriesManifest& before, const store::SeriesManifest& after) {
  return after.dataset_id == before.dataset_id && after.shard_count == before.shard_count &&
         std::all_of(before.volumes.begin(), before.volumes.end(),
                     [&](const store::ScalarVolume& volume) {
                       const store::ScalarVolume* found = after.Find(volume.key);
                       return found != nullptr && *found == volume;
                     });
}

// Ends what a process began that was killed after step 3 of appending.
absl::Status Recover(const std::string& directory, SeriesWorkFolder* folder,
                     store::SeriesManifest* series) {
  const std::string path = absl::StrCat(folder->path(), "/", store::kManifestFileName);
  const absl::StatusOr<std::string> bytes = io::ReadWholeFile(path, store::kMaxSeriesManifestBytes);
  if (!bytes.ok()) {
    return absl::IsNotFound(bytes.status()) ? absl::OkStatus() : bytes.status();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(store::SeriesManifest after, store::DecodeSeriesManifest(*bytes, path));
  if (Continues(*series, after)) {
    ISOSCOPE_RETURN_IF_ERROR(MoveIntoSeries(directory, *folder, *series, after));
    *series = std::move(after);
  }
  return folder->Clear();
}

absl::StatusOr<store::SeriesManifest> OpenToAppend(const std::string& directory) {
  if (store::IsDatasetDirectory(directory) && !store::IsSeriesDirectory(directory)) {
    return absl::FailedPreconditionError(
        absl::StrCat(directory,
                     ": a dataset of one field and step: nothing can be appended; partition its "
                     "first step with --time"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(store::SeriesDescription series, store::OpenSeries(directory));
  for (std::size_t shard = 0; shard < series.shard_directories.size(); ++shard) {
    if (series.shard_directories[shard].empty()) {
      return absl::FailedPreconditionError(absl::StrFormat(
          "%s: shard %d of %d is not there; append where all shards are, and copy them then",
          directory, shard, series.shard_directories.size()));
    }
  }
  return std::move(series.manifest);
}

// Copied volumes are dealt out in another way than those whose samples stay in the source.
absl::Status CheckHoldsSamples(const std::string& directory, const store::SeriesManifest& series) {
  if (series.volumes.empty()) {
    return absl::OkStatus();
  }
  // A folder that is missing is told by others.
  const auto samples = store::SamplesOfVolume(
      absl::StrCat(directory, "/", store::ShardDirectoryName(0, series.shard_count)),
      series.volumes.front().key);
  return samples.ok() && samples->has_value()
             ? absl::FailedPreconditionError(absl::StrCat(
                   directory,
                   ": is index-only, and nothing can be appended: partition the source with all "
                   "its steps anew, with --index-only"))
             : absl::OkStatus();
}

}  // namespace

// The ids of volumes are digests of samples, grid and cut.
std::string ComputeSeriesId(const store::SeriesManifest& series) {
  std::string text = "isoscope series 1\n";
  const auto add = [&text](absl::string_view part) {
    absl::StrAppend(&text, part.size(), " ", part, "\n");
  };
  add(absl::StrCat(series.shard_count));
  add(series.length_unit);
  add(series.time_unit);
  add(series.times.empty() ? "" : absl::StrFormat("%a", series.times[0]));
  for (const store::Field& field : series.fields) {
    add(field.name);
    add(field.unit);
    for (const store::FieldComponent& component : field.components) {
      add(component.name);
    }
  }
  for (const store::ScalarVolume& volume : series.volumes) {
    if (volume.key.step == series.volumes.front().key.step) {  // ascending by step
      add(store::ScalarVolumeDirectoryName(volume.key));
      add(volume.dataset_id);
    }
  }
  for (const volume::Label& label : series.labels) {
    add(absl::StrFormat("label %a", label.value));
    add(label.name);
    add(label.color.has_value() ? volume::ToHex(*label.color) : "");
  }
  constexpr std::size_t kIdDigits = 32;
  return base::Sha256Hex(text).substr(0, kIdDigits);
}

absl::Status WriteSeriesManifests(const std::string& directory,
                                  const store::SeriesManifest& series) {
  for (int shard = 0; shard < series.shard_count; ++shard) {
    ISOSCOPE_RETURN_IF_ERROR(store::WriteSeriesManifest(
        absl::StrCat(directory, "/", store::ShardDirectoryName(shard, series.shard_count)), series,
        shard));
  }
  return store::WriteSeriesManifest(directory, series, -1);
}

bool NeedsSeries(const source::VolumeSeries& source) {
  return source.info().fields.size() > 1 || source.info().fields[0].components.size() > 1 ||
         !source.info().times.empty();
}

absl::StatusOr<store::SeriesManifest> PartitionSeries(source::VolumeSeries& source,
                                                      const SeriesPartitionOptions& options,
                                                      const base::Cancellation& cancellation) {
  if (options.volume.distribution != store::Distribution::kRandom) {
    return absl::InvalidArgumentError(
        "the greedy distribution follows the values of one volume; blocks of a series are dealt "
        "out at random");
  }
  const std::string output = TrimmedPath(options.volume.output_directory);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<OutputFolder> checked,
                            OutputFolder::Make(output, options.volume.name));
  ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
  ISOSCOPE_ASSIGN_OR_RETURN(store::SeriesManifest series,
                            PlanSeries(source, options.volume, checked->name()));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<VolumeTask> tasks,
                            PlanVolumes(source, series, options.wants));
  ISOSCOPE_RETURN_IF_ERROR(CheckGrids(source, tasks, series, cancellation));
  PartitionOptions of_volume = WithManifestMemory(options.volume, tasks.size());
  if (of_volume.in_source.has_value()) {
    of_volume.keeps_units = true;
    ISOSCOPE_RETURN_IF_ERROR(PlanUnitsOfSeries(source, series, &*of_volume.in_source));
  }

  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<SeriesWorkFolder> folder,
                            SeriesWorkFolder::Take(output + ".partial"));
  ISOSCOPE_RETURN_IF_ERROR(PrepareFolder(options.resumes, series.shard_count, folder.get()));
  ISOSCOPE_RETURN_IF_ERROR(
      WriteVolumes(source, tasks, of_volume, folder.get(), &series, cancellation));
  ISOSCOPE_RETURN_IF_ERROR(folder->RemoveOtherVolumes(KeysOf(tasks)));
  series.dataset_id = ComputeSeriesId(series);
  ISOSCOPE_RETURN_IF_ERROR(WriteSeriesManifests(folder->path(), series));
  ISOSCOPE_RETURN_IF_ERROR(folder->MoveTo(output));
  return series;
}

absl::StatusOr<store::SeriesManifest> AppendToSeries(source::VolumeSeries& source,
                                                     const SeriesPartitionOptions& options,
                                                     const base::Cancellation& cancellation) {
  const std::string directory = TrimmedPath(options.volume.output_directory);
  if (options.volume.in_source.has_value()) {
    return absl::InvalidArgumentError("what is appended to a series is copied into it");
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const store::SeriesManifest found, OpenToAppend(directory));
  ISOSCOPE_RETURN_IF_ERROR(CheckHoldsSamples(directory, found));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::unique_ptr<SeriesWorkFolder> folder,
      SeriesWorkFolder::Take(absl::StrCat(directory, "/", kAppendFolderName)));
  // Again, now that nobody else writes.
  ISOSCOPE_ASSIGN_OR_RETURN(const store::SeriesManifest opened, OpenToAppend(directory));
  store::SeriesManifest before = opened;
  ISOSCOPE_RETURN_IF_ERROR(RemovePartialManifests(directory, before.shard_count));
  ISOSCOPE_RETURN_IF_ERROR(Recover(directory, folder.get(), &before));
  store::SeriesManifest series = before;
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<VolumeTask> tasks,
                            PlanAppending(source, options.resumes, &series));
  if (tasks.empty()) {
    return series;
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckGrids(source, tasks, series, cancellation));
  ISOSCOPE_RETURN_IF_ERROR(PrepareFolder(options.resumes, series.shard_count, folder.get()));
  ISOSCOPE_RETURN_IF_ERROR(WriteVolumes(
      source, tasks,
      WithLevelsOf(before,
                   WithManifestMemory(options.volume, series.volumes.size() + tasks.size())),
      folder.get(), &series, cancellation));
  ISOSCOPE_RETURN_IF_ERROR(folder->RemoveOtherVolumes(KeysOf(tasks)));
  ISOSCOPE_RETURN_IF_ERROR(store::WriteSeriesManifest(folder->path(), series, -1));
  ISOSCOPE_RETURN_IF_ERROR(MoveIntoSeries(directory, *folder, before, series));
  ISOSCOPE_RETURN_IF_ERROR(folder->Clear());
  return series;
}

}  // namespace isoscope::partition
