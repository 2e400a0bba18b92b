// Writes scalar volumes of a source into a work folder, one after the other. Internal to the series
// partitioner.

#ifndef ISOSCOPE_CORE_PARTITION_SERIES_WRITER_H_
#define ISOSCOPE_CORE_PARTITION_SERIES_WRITER_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/partition/partitioner.h"
#include "core/partition/series_work_folder.h"
#include "core/source/volume_series.h"
#include "core/store/series_manifest.h"

namespace isoscope::partition {

// A scalar volume to write: which one it is in the series, and where it lies in the source. A
// component behind those of the source's field is the magnitude.
struct VolumeTask {
  store::ScalarVolumeKey key;
  int field = 0;
  int component = 0;
  int step = 0;
};

// Opens what the task names. Errors as VolumeSeries::Open.
absl::StatusOr<std::unique_ptr<source::VolumeSource>> OpenTask(source::VolumeSeries& source,
                                                               const VolumeTask& task);

// Returns where the samples of the task's volume are, if `all` says it of the source.
store::SourceSamples SamplesOfTask(const source::VolumeSeries& source, const VolumeTask& task,
                                   store::SourceSamples all);

// Returns "field "u", component x, step 3" of the source.
std::string NameOf(const source::VolumeSeries& source, const VolumeTask& task);

// INVALID_ARGUMENT, with field, step and both values, unless the volume has the grid of the series
// and, of its component, the sample type.
absl::Status CheckFits(const source::VolumeSeries& source, const VolumeTask& task,
                       const source::VolumeSource& volume, const store::SeriesManifest& series);

// Writes the volumes of the tasks in their order, and adds them to series->volumes. Those that the
// folder holds already are kept. On an error the folder keeps those that are finished; the message
// says how many.
//
// options: of each volume, but for its folder and names; progress is of all tasks
absl::Status WriteVolumes(source::VolumeSeries& source, const std::vector<VolumeTask>& tasks,
                          const PartitionOptions& options, SeriesWorkFolder* folder,
                          store::SeriesManifest* series, const base::Cancellation& cancellation);

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_SERIES_WRITER_H_
