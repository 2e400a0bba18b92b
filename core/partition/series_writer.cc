// Each volume takes these steps, so that a process may end after any of them:
//
//   1. Its fingerprint is compared with the one of a finished volume in the folder: kept if equal,
//      and if the volume is whole.
//   2. Partition writes it as a dataset of version 1.
//   3. The folder moves its shards to their places, and records the fingerprint.
//
// The fingerprint names all that decides the bytes: the identity of the step, which has the whole
// request and the stamps of the files; the volume in it; and the parameters of the cut. The
// identity is looked at again once the volume was read: a source that has changed meanwhile gives
// an error, not a mixture.

#include "core/partition/series_writer.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/sha256.h"
#include "core/base/status_macros.h"
#include "core/source/adapt/magnitude_source.h"
#include "core/store/source_volume.h"

namespace isoscope::partition {
namespace {

std::string TextOf(const math::Index3& v) { return absl::StrFormat("%d, %d, %d", v.x, v.y, v.z); }
std::string TextOf(const math::Vec3d& v) {
  return absl::StrFormat("%.17g, %.17g, %.17g", v.x, v.y, v.z);
}

std::string TextOf(const math::Mat3d& m) {
  return absl::StrCat(TextOf(m.columns[0]), "; ", TextOf(m.columns[1]), "; ", TextOf(m.columns[2]));
}

std::string TextOf(const std::optional<volume::PatientFrame>& frame) {
  return frame.has_value() ? frame->name() : "none";
}

const volume::ScalarType& TypeOf(const store::SeriesManifest& series,
                                 const store::ScalarVolumeKey& key) {
  return series.fields[static_cast<std::size_t>(key.field)]
      .components[static_cast<std::size_t>(key.component)]
      .scalar_type;
}

std::string FingerprintOf(const std::string& identity, const source::VolumeSeries& source,
                          const VolumeTask& task, const source::VolumeSource& volume,
                          const PartitionOptions& options, const store::SeriesManifest& series) {
  const std::string levels = options.levels.highest > 0
                                 ? absl::StrCat("\nlevels ", options.levels.highest, " ",
                                                volume::NameOf(*options.levels.filter))
                                 : "";
  return base::Sha256Hex(absl::StrCat(
      "isoscope volume 2\n", NameOf(source, task), "\n", task.field, " ", task.component, "\n",
      volume.info().name, "\n", volume::NameOf(volume.info().type), "\n", identity, series.name,
      "\n", series.source, "\n", TextOf(series.geometry.sample_dims), "\n",
      TextOf(series.geometry.spacing), "\n", TextOf(series.geometry.origin), "\n",
      TextOf(series.geometry.direction), "\n", TextOf(series.patient_frame), "\n",
      TextOf(series.block_cells), "\n", series.shard_count, " ", series.seed, " ",
      static_cast<int>(options.compression), levels));
}

// The finished part of all progress.
class TotalProgress {
 public:
  TotalProgress(const std::function<void(const PartitionProgress&)>& report,
                const std::vector<VolumeTask>& tasks, const store::SeriesManifest& series)
      : report_(report) {
    for (const VolumeTask& task : tasks) {
      total_bytes_ += BytesOf(task, series);
    }
  }
  void Begin(std::string phase, const VolumeTask& task, const store::SeriesManifest& series) {
    phase_ = std::move(phase);
    volume_bytes_ = BytesOf(task, series);
  }
  // share: of the volume with its levels, 0 to 1
  void Report(double share) const {
    if (report_) {
      report_({.phase = phase_.c_str(),
               .done_bytes = done_bytes_ +
                             static_cast<std::int64_t>(share * static_cast<double>(volume_bytes_)),
               .total_bytes = total_bytes_});
    }
  }
  void End() {
    done_bytes_ += volume_bytes_;
    Report(0);
  }

 private:
  static std::int64_t BytesOf(const VolumeTask& task, const store::SeriesManifest& series) {
    return math::Volume(series.geometry.sample_dims) *
           static_cast<std::int64_t>(volume::SizeOf(TypeOf(series, task.key)));
  }

  const std::function<void(const PartitionProgress&)>& report_;
  std::string phase_;
  std::int64_t volume_bytes_ = 0;  // of the volume under way
  std::int64_t done_bytes_ = 0;
  std::int64_t total_bytes_ = 0;
};

// The levels of a volume, in numbers: the filter is that of earlier steps of its field, if there
// are any with levels.
absl::StatusOr<LevelOptions> LevelsOf(LevelOptions options, const store::SeriesManifest& series,
                                      const store::ScalarVolumeKey& key) {
  for (const store::ScalarVolume& volume : series.volumes) {
    if (volume.key.field == key.field && volume.key.component == key.component &&
        volume.highest_level > 0) {
      options.filter = volume.level_filter;
      break;
    }
  }
  ISOSCOPE_ASSIGN_OR_RETURN(
      const LevelPlan plan,
      PlanLevels(options, series.geometry, TypeOf(series, key), series.block_cells,
                 series.shard_count, !series.labels.empty()));
  return LevelOptions{.highest = plan.highest, .filter = plan.filter};
}

absl::Status WriteVolume(source::VolumeSource* volume, PartitionOptions options,
                         const SeriesWorkFolder& folder, const store::SeriesManifest& series,
                         const base::Cancellation& cancellation) {
  options.output_directory = folder.volume_path();
  options.name = series.name;
  options.source_name = series.source;
  options.shard_count = series.shard_count;
  options.block_cells = series.block_cells;
  options.distribution = store::Distribution::kRandom;
  options.seed = series.seed;
  options.labels.clear();  // the series has them
  return Partition(*volume, options, cancellation).status();
}

// Writes the volume of a task, unless the folder has it.
absl::Status WriteTask(source::VolumeSeries& source, const VolumeTask& task,
                       PartitionOptions options, SeriesWorkFolder* folder,
                       const store::SeriesManifest& series,
                       const base::Cancellation& cancellation) {
  // Before the first byte is read.
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string identity, source.IdentityOfStep(task.step));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSource> volume,
                            OpenTask(source, task));
  ISOSCOPE_RETURN_IF_ERROR(CheckFits(source, task, *volume, series));
  ISOSCOPE_ASSIGN_OR_RETURN(options.levels, LevelsOf(options.levels, series, task.key));
  const std::string fingerprint = FingerprintOf(identity, source, task, *volume, options, series);
  ISOSCOPE_ASSIGN_OR_RETURN(const bool is_finished,
                            folder->IsFinished(task.key, fingerprint, cancellation));
  if (is_finished) {
    return absl::OkStatus();
  }
  if (options.in_source.has_value()) {
    options.in_source = SamplesOfTask(source, task, *std::move(options.in_source));
  }
  ISOSCOPE_RETURN_IF_ERROR(WriteVolume(volume.get(), options, *folder, series, cancellation));
  ISOSCOPE_RETURN_IF_ERROR(source.IdentityOfStep(task.step).status());
  return folder->Finish(task.key, fingerprint);
}

}  // namespace

absl::StatusOr<std::unique_ptr<source::VolumeSource>> OpenTask(source::VolumeSeries& source,
                                                               const VolumeTask& task) {
  return source::OpenComponent(source, task.field, task.component, task.step);
}

store::SourceSamples SamplesOfTask(const source::VolumeSeries& source, const VolumeTask& task,
                                   store::SourceSamples all) {
  all.request[store::kFieldMember] = source.info().field(task.field).name;
  all.request[store::kComponentMember] = absl::StrCat(task.component);
  all.request[store::kStepMember] = absl::StrCat(task.step);
  return all;
}

std::string NameOf(const source::VolumeSeries& source, const VolumeTask& task) {
  const source::SourceField& field = source.info().field(task.field);
  std::string name = absl::StrCat("field \"", field.name, "\"");
  if (field.components.size() > 1) {
    const auto component = static_cast<std::size_t>(task.component);
    absl::StrAppend(&name, ", component ",
                    component < field.components.size()
                        ? absl::string_view(field.components[component])
                        : store::kMagnitudeName);
  }
  if (!source.info().times.empty()) {
    absl::StrAppend(&name, ", step ", task.step, " (time ",
                    source.info().times[static_cast<std::size_t>(task.step)], ")");
  }
  return name;
}

absl::Status CheckFits(const source::VolumeSeries& source, const VolumeTask& task,
                       const source::VolumeSource& volume, const store::SeriesManifest& series) {
  const auto differs = [&](absl::string_view what, absl::string_view found,
                           absl::string_view expected) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %s: %s %s, the first volume of the series has %s; all volumes of a "
                        "series have the same",
                        volume.info().name, NameOf(source, task), what, found, expected));
  };
  const volume::GridGeometry& grid = volume.info().geometry;
  const volume::GridGeometry& expected = series.geometry;
  if (!(grid.sample_dims == expected.sample_dims)) {
    return differs("dimensions", TextOf(grid.sample_dims), TextOf(expected.sample_dims));
  }
  if (!(grid.spacing == expected.spacing)) {
    return differs("spacing", TextOf(grid.spacing), TextOf(expected.spacing));
  }
  if (!(grid.origin == expected.origin)) {
    return differs("origin", TextOf(grid.origin), TextOf(expected.origin));
  }
  if (!(grid.direction == expected.direction)) {
    return differs("directions", TextOf(grid.direction), TextOf(expected.direction));
  }
  if (volume.info().patient_frame != series.patient_frame) {
    return differs("patient frame", TextOf(volume.info().patient_frame),
                   TextOf(series.patient_frame));
  }
  if (const volume::ScalarType type = TypeOf(series, task.key); volume.info().type != type) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: %s: samples of %s, at other steps of %s; a field has one type at all steps",
        volume.info().name, NameOf(source, task), volume::NameOf(volume.info().type),
        volume::NameOf(type)));
  }
  return absl::OkStatus();
}

absl::Status WriteVolumes(source::VolumeSeries& source, const std::vector<VolumeTask>& tasks,
                          const PartitionOptions& options, SeriesWorkFolder* folder,
                          store::SeriesManifest* series, const base::Cancellation& cancellation) {
  TotalProgress progress(options.progress, tasks, *series);
  PartitionOptions volume_options = options;
  volume_options.progress = [&progress](const PartitionProgress& volume_progress) {
    progress.Report(static_cast<double>(volume_progress.done_bytes) /
                    static_cast<double>(std::max<std::int64_t>(volume_progress.total_bytes, 1)));
  };
  for (std::size_t i = 0; i < tasks.size(); ++i) {
    const VolumeTask& task = tasks[i];
    progress.Begin(absl::StrCat("volume ", i + 1, " of ", tasks.size()), task, *series);
    const absl::Status status = [&]() -> absl::Status {
      ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
      ISOSCOPE_RETURN_IF_ERROR(
          WriteTask(source, task, volume_options, folder, *series, cancellation));
      ISOSCOPE_ASSIGN_OR_RETURN(series->volumes.emplace_back(), folder->Describe(task.key));
      return absl::OkStatus();
    }();
    if (!status.ok() && options.in_source.has_value()) {
      folder->Clear().IgnoreError();  // nothing goes on with them
      return status;
    }
    if (!status.ok() && i > 0) {
      return {status.code(),
              absl::StrFormat("%s; %d of %d volumes are finished and kept in %s: --resume goes on "
                              "with them",
                              status.message(), i, tasks.size(), folder->path())};
    }
    ISOSCOPE_RETURN_IF_ERROR(status);
    progress.End();
  }
  std::sort(
      series->volumes.begin(), series->volumes.end(),
      [](const store::ScalarVolume& a, const store::ScalarVolume& b) { return a.key < b.key; });
  return absl::OkStatus();
}

}  // namespace isoscope::partition
