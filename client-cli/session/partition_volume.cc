#include "client-cli/session/partition_volume.h"

#include <memory>

#include "clients/cpp/request/parse_value.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/cli/progress_line.h"
#include "core/store/shard_format.h"

namespace isoscope::cli {
namespace {

// Memory of the process apart from the partitioner's tables and samples: code, libraries, stacks.
// Measured before the first block: 37 MiB.
constexpr std::int64_t kProcessBytes = 40 * base::kMiB;

}  // namespace

absl::StatusOr<std::int64_t> ParseShardCount(absl::string_view text) {
  return client::ParseInteger(text, 1, store::kMaxShardCount);
}

absl::StatusOr<store::Manifest> PartitionVolume(const SourceFlags& flags, const std::string& input,
                                                partition::PartitionOptions options,
                                                const Context& context) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSource> source,
                            OpenSource(flags, input));
  options.reserved_bytes = kProcessBytes;
  ProgressLine line(context.err, context.err_is_terminal);
  options.progress = [&line](const partition::PartitionProgress& progress) {
    if (progress.total_bytes > 0) {
      line.Update(progress.phase, progress.done_bytes, progress.total_bytes);
    }
  };
  absl::StatusOr<store::Manifest> manifest =
      partition::Partition(*source, options, context.interrupt->cancellation());
  if (!manifest.ok() && context.interrupt->cancellation().is_cancelled()) {
    return absl::CancelledError("interrupted while partitioning; nothing was left behind");
  }
  return manifest;
}

}  // namespace isoscope::cli
