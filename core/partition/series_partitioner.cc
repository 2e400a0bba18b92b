// A new series:
//
//   1  The plan: fields and components, the grid of the first volume, and a task for each scalar
//      volume, by step, field and component. All steps are opened once, so that grids that differ
//      are found before anything is written.
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
#include <filesystem>
#include <memory>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/sha256.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/partition/output_folder.h"
#include "core/partition/partition_plan.h"
#include "core/partition/series_work_folder.h"
#include "core/partition/series_writer.h"
#include "core/store/shard_format.h"
#include "core/store/shard_reader.h"
#include "core/volume/block_layout.h"

namespace isoscope::partition {
namespace {

constexpr absl::string_view kAppendFolderName = "append.partial";
// Memory of one scalar volume in the manifest and its JSON, while it is written.
constexpr std::int64_t kManifestBytesPerVolume = 2 * base::kKiB;

int ComponentCount(const source::SourceField& field) {
  const auto count = static_cast<int>(field.components.size());
  return count > 1 ? count + 1 : 1;  // and the magnitude
}

std::string TrimmedPath(std::string path) {
  while (path.size() > 1 && path.back() == '/') {
    path.pop_back();
  }
  return path;
}

absl::StatusOr<store::Field> DescribeField(source::VolumeSeries& source, int index) {
  const source::SourceField& from = source.fields()[static_cast<std::size_t>(index)];
  store::Field field{
      .name = from.name, .long_name = from.long_name, .unit = from.unit, .components = {}};
  for (int component = 0; component < ComponentCount(from); ++component) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        const std::unique_ptr<source::VolumeSource> volume,
        OpenTask(source, {.key = {}, .field = index, .component = component, .step = 0}));
    const auto i = static_cast<std::size_t>(component);
    std::string name =
        i < from.components.size() ? from.components[i] : std::string(store::kMagnitudeName);
    if (from.components.size() == 1) {
      name.clear();
    }
    field.components.push_back({.name = std::move(name), .scalar_type = volume->scalar_type()});
  }
  return field;
}

// Digest of grid, cut, fields and the first step. The ids of volumes are digests of samples, grid
// and cut.
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
    if (volume.key.step == 0) {
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

// The error that the manifest would have, before the volumes are written.
absl::Status CheckManifest(store::SeriesManifest series, const std::string& name) {
  series.dataset_id = std::string(32, '0');
  series.volumes = {
      {.key = {}, .dataset_id = series.dataset_id, .manifest_crc32c = 0, .value_range = {}}};
  const absl::Status status =
      store::DecodeSeriesManifest(store::EncodeSeriesManifest(series), name).status();
  return status.ok() ? status : absl::InvalidArgumentError(status.message());
}

absl::Status CheckCounts(std::size_t field_count, std::size_t step_count, std::size_t volume_count,
                         const std::string& name) {
  if (field_count > static_cast<std::size_t>(store::kMaxFields) ||
      step_count > static_cast<std::size_t>(store::kMaxSteps) ||
      volume_count > static_cast<std::size_t>(store::kMaxScalarVolumes)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: %d fields, %d steps, %d scalar volumes: a series has at most %d, %d and %d", name,
        field_count, step_count, volume_count, store::kMaxFields, store::kMaxSteps,
        store::kMaxScalarVolumes));
  }
  return absl::OkStatus();
}

// Opens the first component of each field at each step, and compares the grids.
absl::Status CheckGrids(source::VolumeSeries& source, const std::vector<VolumeTask>& tasks,
                        const store::SeriesManifest& series,
                        const base::Cancellation& cancellation) {
  for (const VolumeTask& task : tasks) {
    if (task.component == 0) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
      ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSource> volume,
                                OpenTask(source, task));
      ISOSCOPE_RETURN_IF_ERROR(CheckFits(source, task, *volume, series));
    }
  }
  return absl::OkStatus();
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

// A series as its source and the options have it, without volumes.
absl::StatusOr<store::SeriesManifest> PlanSeries(source::VolumeSeries& source,
                                                 const PartitionOptions& options,
                                                 const std::string& name) {
  store::SeriesManifest series;
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSource> first,
                            source.Open(0, 0, 0));
  ISOSCOPE_RETURN_IF_ERROR(volume::Validate(first->geometry()));
  series.name = name;
  series.source = options.source_name.empty() ? BaseName(source.name()) : options.source_name;
  series.geometry = first->geometry();
  series.patient_frame = first->patient_frame();
  series.length_unit = source.length_unit();
  series.block_cells =
      options.block_cells.value_or(volume::DefaultBlockCells(series.geometry.sample_dims));
  series.seed = options.seed;
  series.shard_count = options.shard_count;
  series.times = source.times();
  series.time_unit = source.time_unit();
  series.labels = options.labels;
  ISOSCOPE_ASSIGN_OR_RETURN(
      const volume::BlockLayout layout,
      volume::BlockLayout::Make(series.geometry.sample_dims, series.block_cells));
  ISOSCOPE_RETURN_IF_ERROR(ValidateShardCount(series.shard_count, layout));
  for (std::size_t field = 0; field < source.fields().size(); ++field) {
    ISOSCOPE_ASSIGN_OR_RETURN(series.fields.emplace_back(),
                              DescribeField(source, static_cast<int>(field)));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckManifest(series, source.name()));
  return series;
}

std::vector<VolumeTask> TasksOfAll(const source::VolumeSeries& source) {
  std::vector<VolumeTask> tasks;
  for (int step = 0; step < source.step_count(); ++step) {
    for (int field = 0; field < static_cast<int>(source.fields().size()); ++field) {
      const int components = ComponentCount(source.fields()[static_cast<std::size_t>(field)]);
      for (int component = 0; component < components; ++component) {
        tasks.push_back({.key = {.field = field, .component = component, .step = step},
                         .field = field,
                         .component = component,
                         .step = step});
      }
    }
  }
  return tasks;
}

absl::Status WriteManifests(const std::string& directory, const store::SeriesManifest& series) {
  for (int shard = 0; shard < series.shard_count; ++shard) {
    ISOSCOPE_RETURN_IF_ERROR(store::WriteSeriesManifest(
        absl::StrCat(directory, "/", store::ShardDirectoryName(shard, series.shard_count)), series,
        shard));
  }
  return store::WriteSeriesManifest(directory, series, -1);
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
  return WriteManifests(directory, after);
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

absl::Status CheckUnits(const std::string& what, const std::string& source,
                        const std::string& series, const std::string& name) {
  if (!source.empty() && source != series) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %s \"%s\", the series has \"%s\"", name, what, source, series));
  }
  return absl::OkStatus();
}

// Returns the index of the series' field that is the source's.
absl::StatusOr<int> FindField(const source::SourceField& field, const store::SeriesManifest& series,
                              const std::string& name) {
  const auto found =
      std::find_if(series.fields.begin(), series.fields.end(),
                   [&](const store::Field& known) { return known.name == field.name; });
  if (found == series.fields.end()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: field \"%s\": the series has the fields %s; --field chooses fields of the source",
        name, field.name,
        absl::StrJoin(series.fields, ", ", [](std::string* out, const store::Field& known) {
          absl::StrAppend(out, "\"", known.name, "\"");
        })));
  }
  std::vector<std::string> components;
  for (const store::FieldComponent& component : found->components) {
    components.push_back(component.name);
  }
  if (components.size() > 1) {
    components.pop_back();  // the magnitude
  }
  const bool is_scalar = components.size() == 1 && field.components.size() == 1;
  if (!is_scalar && components != field.components) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: field \"%s\" has the components [%s], in the series [%s]", name, field.name,
        absl::StrJoin(field.components, ", "), absl::StrJoin(components, ", ")));
  }
  ISOSCOPE_RETURN_IF_ERROR(
      CheckUnits(absl::StrCat("field \"", field.name, "\": unit"), field.unit, found->unit, name));
  return static_cast<int>(found - series.fields.begin());
}

// Returns the step of the series that has the time, which is appended if it is later than all.
absl::StatusOr<int> FindOrAddStep(double time, const std::string& name,
                                  store::SeriesManifest* series) {
  const auto found = std::find(series->times.begin(), series->times.end(), time);
  if (found != series->times.end()) {
    return static_cast<int>(found - series->times.begin());
  }
  if (time < series->times.back()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: time %.17g: the last step of the series has %.17g; expected a later time", name, time,
        series->times.back()));
  }
  series->times.push_back(time);
  return static_cast<int>(series->times.size()) - 1;
}

// The tasks of appending; adds the new steps to `series`. What the series has already is left out
// by one that resumes.
absl::StatusOr<std::vector<VolumeTask>> PlanAppending(const source::VolumeSeries& source,
                                                      bool resumes, store::SeriesManifest* series) {
  const std::string& name = source.name();
  if (series->times.empty()) {
    return absl::FailedPreconditionError(
        absl::StrCat(series->name,
                     ": the series has no times, so nothing can follow; partition the first step "
                     "with --time"));
  }
  if (source.times().empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(name, ": the source has no time: give it with --time VALUE"));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckUnits("unit of time", source.time_unit(), series->time_unit, name));
  ISOSCOPE_RETURN_IF_ERROR(
      CheckUnits("unit of length", source.length_unit(), series->length_unit, name));
  std::vector<VolumeTask> tasks;
  for (VolumeTask task : TasksOfAll(source)) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        task.key.field,
        FindField(source.fields()[static_cast<std::size_t>(task.field)], *series, name));
    const double time = source.times()[static_cast<std::size_t>(task.step)];
    ISOSCOPE_ASSIGN_OR_RETURN(task.key.step, FindOrAddStep(time, name, series));
    if (series->Find(task.key) == nullptr) {
      tasks.push_back(task);
    } else if (!resumes) {
      return absl::AlreadyExistsError(absl::StrFormat(
          "%s: the series has this field at time %.17g already", NameOf(source, task), time));
    }
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckCounts(series->fields.size(), series->times.size(),
                                       series->volumes.size() + tasks.size(), name));
  return tasks;
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

}  // namespace

bool NeedsSeries(const source::VolumeSeries& source) {
  return source.fields().size() > 1 || source.fields()[0].components.size() > 1 ||
         !source.times().empty();
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
  const std::vector<VolumeTask> tasks = TasksOfAll(source);
  ISOSCOPE_RETURN_IF_ERROR(
      CheckCounts(series.fields.size(), series.times.size(), tasks.size(), source.name()));
  ISOSCOPE_RETURN_IF_ERROR(CheckGrids(source, tasks, series, cancellation));

  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<SeriesWorkFolder> folder,
                            SeriesWorkFolder::Take(output + ".partial"));
  ISOSCOPE_RETURN_IF_ERROR(PrepareFolder(options.resumes, series.shard_count, folder.get()));
  ISOSCOPE_RETURN_IF_ERROR(WriteVolumes(source, tasks,
                                        WithManifestMemory(options.volume, tasks.size()),
                                        folder.get(), &series, cancellation));
  ISOSCOPE_RETURN_IF_ERROR(folder->RemoveOtherVolumes(KeysOf(tasks)));
  series.dataset_id = ComputeSeriesId(series);
  ISOSCOPE_RETURN_IF_ERROR(WriteManifests(folder->path(), series));
  ISOSCOPE_RETURN_IF_ERROR(folder->MoveTo(output));
  return series;
}

absl::StatusOr<store::SeriesManifest> AppendToSeries(source::VolumeSeries& source,
                                                     const SeriesPartitionOptions& options,
                                                     const base::Cancellation& cancellation) {
  const std::string directory = TrimmedPath(options.volume.output_directory);
  ISOSCOPE_RETURN_IF_ERROR(OpenToAppend(directory).status());
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
      source, tasks, WithManifestMemory(options.volume, series.volumes.size() + tasks.size()),
      folder.get(), &series, cancellation));
  ISOSCOPE_RETURN_IF_ERROR(folder->RemoveOtherVolumes(KeysOf(tasks)));
  ISOSCOPE_RETURN_IF_ERROR(store::WriteSeriesManifest(folder->path(), series, -1));
  ISOSCOPE_RETURN_IF_ERROR(MoveIntoSeries(directory, *folder, before, series));
  ISOSCOPE_RETURN_IF_ERROR(folder->Clear());
  return series;
}

}  // namespace isoscope::partition
