// Partitioning with progress on standard error: for `partition`, and for `render` of a volume.

#ifndef ISOSCOPE_CLIENT_CLI_SESSION_PARTITION_VOLUME_H_
#define ISOSCOPE_CLIENT_CLI_SESSION_PARTITION_VOLUME_H_

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "client-cli/session/source_flags.h"
#include "core/cli/command.h"
#include "core/partition/partitioner.h"
#include "core/partition/series_partitioner.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"
#include "core/store/manifest.h"
#include "core/store/series_manifest.h"

namespace isoscope::cli {

// Parses a number of shards, 1 or more; the partitioner checks the volume's maximum.
absl::StatusOr<std::int64_t> ParseShardCount(absl::string_view text);

// Prints a line on standard error if the grid is not that of the file.
void PrintNote(const source::VolumeSource& source, const Context& context);

// Opens `input`, prints its note and partitions it. `options.progress` and `options.reserved_bytes`
// are replaced: the memory limit is that of the process. CANCELLED on an interrupt, with no files
// left; other errors as OpenSource and partition::Partition.
absl::StatusOr<store::Manifest> PartitionVolume(const SourceFlags& flags, const std::string& input,
                                                partition::PartitionOptions options,
                                                const Context& context);
// The same of a source that is open.
absl::StatusOr<store::Manifest> PartitionVolume(source::VolumeSource& source,
                                                partition::PartitionOptions options,
                                                const Context& context);

enum class SeriesAction { kMake, kAppend };
// Makes a series of a source, or appends it to one, with progress, and replaces the same options.
// CANCELLED on an interrupt, saying what was kept; other errors as partition::PartitionSeries and
// partition::AppendToSeries.
absl::StatusOr<store::SeriesManifest> PartitionSeries(SeriesAction action,
                                                      source::VolumeSeries& source,
                                                      partition::SeriesPartitionOptions options,
                                                      const Context& context);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_SESSION_PARTITION_VOLUME_H_
