// The plan of a series, before anything is written: fields and components, the grid of the first
// volume, and a task for each scalar volume, by step, field and component. All steps are opened
// once (CheckGrids), so that grids that differ are found first. Internal to the series partitioner.

#ifndef ISOSCOPE_CORE_PARTITION_SERIES_PLAN_H_
#define ISOSCOPE_CORE_PARTITION_SERIES_PLAN_H_

#include <functional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/partition/partitioner.h"
#include "core/partition/series_writer.h"
#include "core/source/volume_series.h"
#include "core/store/series_manifest.h"

namespace isoscope::partition {

// Returns a series as its source and the options have it: without volumes and id. INVALID_ARGUMENT
// if it is no series that a manifest can describe.
absl::StatusOr<store::SeriesManifest> PlanSeries(source::VolumeSeries& source,
                                                 const PartitionOptions& options,
                                                 const std::string& name);

// Whether the volumes of a field at a step are wanted; null: all are.
using WantsVolume = std::function<bool(int field, int step)>;

// Returns the tasks of a new series, those of the magnitudes included. INVALID_ARGUMENT: there are
// more of them, or of fields or steps, than a series may have.
absl::StatusOr<std::vector<VolumeTask>> PlanVolumes(const source::VolumeSeries& source,
                                                    const store::SeriesManifest& series,
                                                    const WantsVolume& wants = nullptr);

// Returns the tasks of appending, and adds the new steps to `series`. A run that `resumes` leaves
// out volumes that the series has; for others they are ALREADY_EXISTS. FAILED_PRECONDITION: it has
// no times. INVALID_ARGUMENT: fields, components, units or times do not fit, or are too many.
absl::StatusOr<std::vector<VolumeTask>> PlanAppending(const source::VolumeSeries& source,
                                                      bool resumes, store::SeriesManifest* series);

// Sets the units in which all volumes of an index-only series read their source, so that a block is in
// the same shard in each of them: on each axis those of the field with the longest. INVALID_ARGUMENT:
// as PlanUnits, of a field; units that have more than store::kMaxUnitBytes of a component.
absl::Status PlanUnitsOfSeries(source::VolumeSeries& source, const store::SeriesManifest& series,
                               store::SourceSamples* samples);

// Opens the first component of each field at each step, and compares the grids. Errors as
// CheckFits.
absl::Status CheckGrids(source::VolumeSeries& source, const std::vector<VolumeTask>& tasks,
                        const store::SeriesManifest& series,
                        const base::Cancellation& cancellation);

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_SERIES_PLAN_H_
