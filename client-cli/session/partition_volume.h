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
#include "core/store/manifest.h"

namespace isoscope::cli {

// Parses a number of shards, 1 or more; the partitioner checks the volume's maximum.
absl::StatusOr<std::int64_t> ParseShardCount(absl::string_view text);

// Opens `input` and partitions it. `options.progress` and `options.reserved_bytes` are replaced:
// the memory limit is that of the process. CANCELLED on an interrupt, with no files left; other
// errors as OpenSource and partition::Partition.
absl::StatusOr<store::Manifest> PartitionVolume(const SourceFlags& flags, const std::string& input,
                                                partition::PartitionOptions options,
                                                const Context& context);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_SESSION_PARTITION_VOLUME_H_
