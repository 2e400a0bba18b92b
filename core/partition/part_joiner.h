// Joins the parts of a dataset (part_writer.h) into the dataset.

#ifndef ISOSCOPE_CORE_PARTITION_PART_JOINER_H_
#define ISOSCOPE_CORE_PARTITION_PART_JOINER_H_

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/units.h"
#include "core/partition/partitioner.h"
#include "core/store/manifest.h"
#include "core/store/series_manifest.h"
#include "core/store/shard_format.h"

namespace isoscope::partition {

struct JoinOptions {
  std::int64_t memory_limit_bytes = base::kGiB;
  std::int64_t reserved_bytes = 0;                 // of the limit, for the rest of the process
  std::optional<std::int64_t> max_cached_bytes{};  // as in PartitionOptions
  std::function<void(const PartitionProgress&)> progress{};  // may be null; called from this thread
};

struct JoinedDataset {
  std::string directory;
  int part_count = 0;                             // 0: it was joined before
  std::optional<store::Manifest> volume;          // a dataset of one volume
  std::optional<store::SeriesManifest> series{};  // or a series
};

// Joins all parts into `output`, with the bytes that one process would have written, and removes
// them. The levels are made here. A dataset whose parts were joined, but not removed, is left as it
// is; so is one that has none any more.
//
// output: the dataset's folder to be; also with ".partial" behind it
//
// Memory: under the limit, as Partition; two values a block of the largest part beside it.
// Crash-safe: the output appears whole; parts are removed after that.
//
// NOT_FOUND: no part. FAILED_PRECONDITION: parts are missing, or not of one dataset; the message
// says which and what to run. ALREADY_EXISTS: the output is another dataset. DATA_LOSS: a part is
// damaged. Otherwise errors as Partition.
absl::StatusOr<JoinedDataset> JoinParts(const std::string& output, const JoinOptions& options,
                                        const base::Cancellation& cancellation);

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_PART_JOINER_H_
