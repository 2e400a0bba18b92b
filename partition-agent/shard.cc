#include "partition-agent/shard.h"

#include <utility>

#include "absl/strings/str_format.h"
#include "core/base/file.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/store/shard_format.h"

namespace isoscope::agent {
namespace {

// Holds the upper levels of a tree of millions of blocks; the rest is read when asked for.
constexpr std::int64_t kPageCacheBytes = 4 * base::kMiB;

}  // namespace

absl::StatusOr<std::shared_ptr<const Shard>> OpenShard(const std::string& directory) {
  auto shard = std::make_shared<Shard>();
  ISOSCOPE_ASSIGN_OR_RETURN(shard->reader, store::ShardReader::Open(directory));
  const std::string tree_path = directory + "/" + store::kIntervalTreeFileName;
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<base::RandomAccessFile> file,
                            base::OpenRandomAccessFile(tree_path));
  ISOSCOPE_ASSIGN_OR_RETURN(shard->tree,
                            index::IntervalTree::Open(std::move(file), kPageCacheBytes));
  if (shard->tree->interval_count() > shard->reader->block_count()) {
    return absl::DataLossError(absl::StrFormat(
        "%s: holds %d intervals, its shard %d blocks; copy the whole shard directory again",
        tree_path, shard->tree->interval_count(), shard->reader->block_count()));
  }
  return shard;
}

}  // namespace isoscope::agent
