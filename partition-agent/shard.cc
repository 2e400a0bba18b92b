#include "partition-agent/shard.h"

#include <atomic>
#include <cmath>
#include <utility>

#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/store/shard_format.h"
#include "core/volume/scalar_span.h"

namespace isoscope::agent {
namespace {

// Holds the upper levels of a tree of millions of blocks. Other pages are read when they are
// needed.
constexpr std::int64_t kPageCacheBytes = 4 * base::kMiB;

// Checks that the tree belongs to the shard's blocks. The trees of two shards can agree in size and
// head. But a block is in one shard only. So any answer of another shard's tree names blocks that
// do not have these ordinals, and lacks those that do.
absl::Status CheckTreeIsOfBlocks(const Shard& shard, const std::string& tree_path) {
  const store::ShardReader& reader = *shard.reader;
  for (std::uint32_t ordinal = 0; ordinal < reader.block_count(); ++ordinal) {
    const volume::ScalarSpan span = reader.ranges().Get(reader.block_id(ordinal));
    if (!std::isfinite(span.max) || !volume::IsActive(span, span.max)) {
      continue;  // no isovalue finds this block
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const index::QueryResult result, shard.tree->Query(span.max));
    bool has_block = false;
    for (const index::BlockInterval& interval : result.active) {
      if (interval.ordinal >= reader.block_count() ||
          reader.block_id(interval.ordinal) != interval.block_id) {
        return absl::DataLossError(
            absl::StrFormat("%s: names block %d at place %d, where the shard holds another: it is "
                            "of another shard; "
                            "copy the whole shard directory again",
                            tree_path, interval.block_id, interval.ordinal));
      }
      has_block = has_block || interval.ordinal == ordinal;
    }
    if (!has_block) {
      return absl::DataLossError(absl::StrFormat(
          "%s: lacks block %d at place %d: it is of another shard; copy the whole shard directory "
          "again",
          tree_path, reader.block_id(ordinal), ordinal));
    }
    return absl::OkStatus();
  }
  return absl::OkStatus();
}

}  // namespace

std::uint32_t NextShardNumber() {
  static std::atomic<std::uint32_t> next_number{0};
  return next_number.fetch_add(1);
}

absl::StatusOr<std::shared_ptr<const Shard>> OpenShard(const std::string& directory,
                                                       std::uint32_t number) {
  auto shard = std::make_shared<Shard>();
  shard->number = number;
  ISOSCOPE_ASSIGN_OR_RETURN(shard->reader, store::ShardReader::Open(directory));
  shard->shapes = std::make_shared<const extract::BlockShapes>(shard->reader->layout());
  const std::string tree_path = directory + "/" + store::kIntervalTreeFileName;
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<io::RandomAccessFile> file,
                            io::OpenRandomAccessFile(tree_path));
  ISOSCOPE_ASSIGN_OR_RETURN(shard->tree,
                            index::IntervalTree::Open(std::move(file), kPageCacheBytes));
  if (shard->tree->interval_count() > shard->reader->block_count()) {
    return absl::DataLossError(absl::StrFormat(
        "%s: holds %d intervals, its shard %d blocks; copy the whole shard directory again",
        tree_path, shard->tree->interval_count(), shard->reader->block_count()));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckTreeIsOfBlocks(*shard, tree_path));
  return shard;
}

}  // namespace isoscope::agent
