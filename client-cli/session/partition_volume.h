// Partitioning with progress on standard error: for `partition`, and for `render` of a volume.

#ifndef ISOSCOPE_CLIENT_CLI_SESSION_PARTITION_VOLUME_H_
#define ISOSCOPE_CLIENT_CLI_SESSION_PARTITION_VOLUME_H_

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/cli/command.h"
#include "core/formats/open_request.h"
#include "core/partition/dataset_levels.h"
#include "core/partition/part_joiner.h"
#include "core/partition/part_writer.h"
#include "core/partition/partitioner.h"
#include "core/partition/series_partitioner.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"
#include "core/store/manifest.h"
#include "core/store/series_manifest.h"

namespace isoscope::cli {

// Parses a number of shards, 1 or more; the partitioner checks the volume's maximum.
absl::StatusOr<std::int64_t> ParseShardCount(absl::string_view text);

// Prints a line on standard error if a dataset directory is that of a series, and lacks volumes
// that its manifest names: a copy may be under way, or is damaged.
void WarnIfIncomplete(const std::string& directory, const Context& context);

// Prints a line on standard error if the grid is not that of the file.
void PrintNote(const source::VolumeSource& source, const Context& context);

// Partitions the only volume of a source, and prints its note. `options.progress`,
// `options.reserved_bytes` and `options.check_source` are replaced: the memory limit is that of the
// process. CANCELLED on an interrupt, with no files left; ABORTED if the source changes meanwhile;
// other errors as partition::Partition. REQUIRES: the source was opened by source::OpenIdentified,
// and needs no series (partition::NeedsSeries).
absl::StatusOr<store::Manifest> PartitionVolume(source::VolumeSeries& source,
                                                partition::PartitionOptions options,
                                                const Context& context);

// The same of a source that has one volume, which this opens. INVALID_ARGUMENT: it has several.
// Other errors also as source::OpenIdentified.
absl::StatusOr<store::Manifest> PartitionVolume(const source::OpenRequest& request,
                                                partition::PartitionOptions options,
                                                const Context& context);

enum class SeriesAction { kMake, kAppend };
// Makes a series of a source, or appends it to one, with progress, and replaces the same options.
// Prints the note of its first volume. CANCELLED on an interrupt, saying what was kept; other
// errors as partition::PartitionSeries and partition::AppendToSeries.
absl::StatusOr<store::SeriesManifest> PartitionSeries(SeriesAction action,
                                                      source::VolumeSeries& source,
                                                      partition::SeriesPartitionOptions options,
                                                      const Context& context);

// Cuts one part of a dataset, with progress, and replaces the same options. CANCELLED on an
// interrupt, saying what was kept; other errors as partition::PartitionPart.
absl::StatusOr<partition::PartReport> PartitionPart(source::VolumeSeries& source,
                                                    partition::PartOptions options,
                                                    const Context& context);

// Joins the parts of a dataset, with progress, and replaces the same options. CANCELLED on an
// interrupt; other errors as partition::JoinParts.
absl::StatusOr<partition::JoinedDataset> JoinParts(const std::string& output,
                                                   partition::JoinOptions options,
                                                   const Context& context);

// Adds levels to a dataset, with progress, and replaces the same options. CANCELLED on an
// interrupt; other errors as partition::AddLevels.
absl::StatusOr<int> AddLevels(const std::string& directory, partition::AddLevelsOptions options,
                              const Context& context);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_SESSION_PARTITION_VOLUME_H_
