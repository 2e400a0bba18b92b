// A plan says, before a block is written, which scalar volumes a series gets.
//
//   PlanSeries     the manifest of a new series: the grid of its first volume, and the fields with
//                  their components; the magnitude follows several components
//   PlanVolumes    a task for each field, component and step that is wanted
//   PlanAppending  the same for a series that exists: FindField maps the source's fields by name,
//                  FindOrAddStep maps its times; only a time after the last one makes a step
//   CheckGrids     opens each field and step once, because an error should come before the work
//
// All errors name the source, and the manifest is encoded and decoded once to find those that it
// would have at the end.

#include "core/partition/series_plan.h"

#include <algorithm>
#include <cstddef>
#include <memory>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/partition/output_folder.h"
#include "core/partition/partition_plan.h"
#include "core/volume/block_layout.h"

namespace isoscope::partition {
namespace {

int ComponentCount(const source::SourceField& field) {
  const auto count = static_cast<int>(field.components.size());
  return count > 1 ? count + 1 : 1;  // and the magnitude
}

absl::StatusOr<store::Field> DescribeField(source::VolumeSeries& source, int index) {
  const source::SourceField& from = source.info().field(index);
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
    field.components.push_back({.name = std::move(name), .scalar_type = volume->info().type});
  }
  return field;
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

std::vector<VolumeTask> TasksOfAll(const source::VolumeSeries& source) {
  std::vector<VolumeTask> tasks;
  for (int step = 0; step < source.info().step_count(); ++step) {
    for (int field = 0; field < static_cast<int>(source.info().fields.size()); ++field) {
      const int components = ComponentCount(source.info().field(field));
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

}  // namespace

absl::StatusOr<store::SeriesManifest> PlanSeries(source::VolumeSeries& source,
                                                 const PartitionOptions& options,
                                                 const std::string& name) {
  store::SeriesManifest series;
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSource> first,
                            source.Open(0, 0, 0));
  ISOSCOPE_RETURN_IF_ERROR(volume::Validate(first->info().geometry));
  series.name = name;
  series.source = options.source_name.empty() ? BaseName(source.info().name) : options.source_name;
  series.geometry = first->info().geometry;
  series.patient_frame = first->info().patient_frame;
  series.length_unit = source.info().length_unit;
  series.block_cells =
      options.block_cells.value_or(volume::DefaultBlockCells(series.geometry.sample_dims));
  series.seed = options.seed;
  series.shard_count = options.shard_count;
  series.times = source.info().times;
  series.time_unit = source.info().time_unit;
  series.labels = options.labels;
  ISOSCOPE_ASSIGN_OR_RETURN(
      const volume::BlockLayout layout,
      volume::BlockLayout::Make(series.geometry.sample_dims, series.block_cells));
  ISOSCOPE_RETURN_IF_ERROR(ValidateShardCount(series.shard_count, layout));
  for (std::size_t field = 0; field < source.info().fields.size(); ++field) {
    ISOSCOPE_ASSIGN_OR_RETURN(series.fields.emplace_back(),
                              DescribeField(source, static_cast<int>(field)));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckManifest(series, source.info().name));
  return series;
}

absl::StatusOr<std::vector<VolumeTask>> PlanVolumes(const source::VolumeSeries& source,
                                                    const store::SeriesManifest& series,
                                                    const WantsVolume& wants) {
  std::vector<VolumeTask> tasks = TasksOfAll(source);
  std::erase_if(tasks,
                [&](const VolumeTask& task) { return wants && !wants(task.field, task.step); });
  ISOSCOPE_RETURN_IF_ERROR(
      CheckCounts(series.fields.size(), series.times.size(), tasks.size(), source.info().name));
  return tasks;
}

absl::StatusOr<std::vector<VolumeTask>> PlanAppending(const source::VolumeSeries& source,
                                                      bool resumes, store::SeriesManifest* series) {
  const std::string& name = source.info().name;
  if (series->times.empty()) {
    return absl::FailedPreconditionError(
        absl::StrCat(series->name,
                     ": the series has no times, so nothing can follow; partition the first step "
                     "with --time"));
  }
  if (source.info().times.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(name, ": the source has no time: give it with --time VALUE"));
  }
  ISOSCOPE_RETURN_IF_ERROR(
      CheckUnits("unit of time", source.info().time_unit, series->time_unit, name));
  ISOSCOPE_RETURN_IF_ERROR(
      CheckUnits("unit of length", source.info().length_unit, series->length_unit, name));
  std::vector<VolumeTask> tasks;
  for (VolumeTask task : TasksOfAll(source)) {
    ISOSCOPE_ASSIGN_OR_RETURN(task.key.field,
                              FindField(source.info().field(task.field), *series, name));
    const double time = source.info().times[static_cast<std::size_t>(task.step)];
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

absl::Status PlanUnitsOfSeries(source::VolumeSeries& source, const store::SeriesManifest& series,
                               store::SourceSamples* samples) {
  bool is_first = true;
  std::size_t sample_bytes = 0;  // the most, magnitudes included
  for (std::size_t field = 0; field < series.fields.size(); ++field) {
    for (const store::FieldComponent& component : series.fields[field].components) {
      sample_bytes = std::max(sample_bytes, volume::SizeOf(component.scalar_type));
    }
    const auto components = source.info().fields[field].components.size();
    for (std::size_t component = 0; component < components; ++component) {
      ISOSCOPE_ASSIGN_OR_RETURN(
          const std::unique_ptr<source::VolumeSource> volume,
          source.Open(static_cast<int>(field), static_cast<int>(component), 0));
      store::SourceSamples own;
      ISOSCOPE_RETURN_IF_ERROR(PlanUnits(*volume, &own));
      for (int axis = 0; axis < 3; ++axis) {
        if (is_first || own.unit_dims[axis] > samples->unit_dims[axis]) {
          samples->unit_dims[axis] = own.unit_dims[axis];
          samples->unit_origin[axis] = own.unit_origin[axis];
        }
      }
      is_first = false;
    }
  }
  const math::Index3& dims = samples->unit_dims;
  const double bytes = static_cast<double>(dims.x) * static_cast<double>(dims.y) *
                       static_cast<double>(dims.z) * static_cast<double>(sample_bytes);
  if (bytes > static_cast<double>(store::kMaxUnitBytes)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: can't be indexed alone: all its fields and magnitudes are read in the same chunks, of "
        "%d x %d x %d samples and up to %.0f MiB, at most %d MiB are read for a few blocks; name "
        "one field with --field, write it with smaller chunks, or leave --index-only out",
        source.info().name, dims.x, dims.y, dims.z, bytes / double{base::kMiB},
        store::kMaxUnitBytes / base::kMiB));
  }
  return absl::OkStatus();
}

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

}  // namespace isoscope::partition
