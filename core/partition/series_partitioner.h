// Writes a series: a dataset with several fields or time steps (core/store/series_manifest.h), and
// appends to one.

#ifndef ISOSCOPE_CORE_PARTITION_SERIES_PARTITIONER_H_
#define ISOSCOPE_CORE_PARTITION_SERIES_PARTITIONER_H_

#include <functional>
#include <string>

#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/partition/partitioner.h"
#include "core/source/volume_series.h"
#include "core/store/series_manifest.h"

namespace isoscope::partition {

struct SeriesPartitionOptions {
  // As of a volume: the limit holds for all together, and progress is of all bytes. PartitionSeries
  // refuses the greedy distribution. AppendToSeries takes `output_directory`, which exists,
  // compression and memory alone; the rest, levels too, is as the series has it. Of in_source, the
  // units are set by PartitionSeries, the same ones for all volumes, whose requests get the members that
  // tell them apart; `resumes` is not for it.
  PartitionOptions volume;
  // Takes the scalar volumes that an interrupted run has finished, if neither the request for the
  // source, nor its files (source::StampsOf), nor the parameters have changed since
  // (VolumeSeries::IdentityOfStep). Reads them, and makes damaged ones again.
  bool resumes = false;
  // Whether the volumes of a field at a step are wanted; those that are not are left out, and the
  // series has all steps all the same. At least one is wanted. Null: all are.
  std::function<bool(int field, int step)> wants{};
};

// True if the source has more than one field, component or step, or a time. Another one makes a
// dataset of version 1: Partition(*source.Open(0, 0, 0)).
bool NeedsSeries(const source::VolumeSeries& source);

// Partitions all fields and steps, and the magnitude of each field of several components, and
// returns the manifest. Reads each scalar volume once, and once more for a magnitude. The steps are
// at the head of series_partitioner.cc.
//
// Memory and determinism are those of Partition.
//
// Crash-safe: everything is written to "<output>.partial", which gets its name at the end. An error
// or a cancellation leaves it if a scalar volume was finished: a run that resumes goes on there,
// and any other begins anew.
//
// Errors as Partition. INVALID_ARGUMENT too if volumes differ in grid or sample type; the message
// names field, step and both values. FAILED_PRECONDITION: another process writes this output.
// ABORTED: a file of the source has changed while it was read.
absl::StatusOr<store::SeriesManifest> PartitionSeries(source::VolumeSeries& source,
                                                      const SeriesPartitionOptions& options,
                                                      const base::Cancellation& cancellation);

// Appends the steps of a source to a series. Its fields are among those of the series, known by
// name, with the same components and units. Its times are later than those of the series, or one
// of them for which the series lacks these fields.
//
// Crash-safe: a process that is killed leaves the series as it was, or with all that was appended,
// as soon as the next one appends. Readers see either.
//
// NOT_FOUND, FAILED_PRECONDITION (no series, an index-only one, a shard is missing, another process appends),
// DATA_LOSS as store::OpenSeries; ALREADY_EXISTS: a field at this time. INVALID_ARGUMENT: other
// fields, units, times or grids. Otherwise errors as PartitionSeries.
absl::StatusOr<store::SeriesManifest> AppendToSeries(source::VolumeSeries& source,
                                                     const SeriesPartitionOptions& options,
                                                     const base::Cancellation& cancellation);

// Returns the id of a series: a digest of grid, cut, fields and the first step that has volumes.
// REQUIRES: its volumes are in their order.
std::string ComputeSeriesId(const store::SeriesManifest& series);
// Writes the manifest into the folders of all shards, then into the dataset's.
absl::Status WriteSeriesManifests(const std::string& directory,
                                  const store::SeriesManifest& series);

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_SERIES_PARTITIONER_H_
