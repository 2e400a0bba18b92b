#include "partition-agent/shard/shard.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "absl/strings/str_format.h"

#include "core/base/log.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/store/shard_format.h"
#include "core/store/shard_levels.h"
#include "core/volume/scalar_span.h"

namespace isoscope::agent {
namespace {

// Holds the upper levels of a tree of millions of blocks. Other pages are read when they are
// needed.
constexpr std::int64_t kPageCacheBytes = 4 * base::kMiB;

// A query of the tree reads a page for each 170 blocks that it finds. So the query that finds the
// fewest among this many is made.
constexpr std::int64_t kCandidateCount = 8;

// Returns how much a query finds: blocks of the shard, or, of a span_tree.bin, pages of the volume.
// Counts no further than `enough`.
std::int64_t CountFound(const store::ShardReader& reader, double isovalue, std::int64_t enough) {
  if (reader.has_span_tree()) {
    return reader.CountActivePages(isovalue);
  }
  const volume::RangeTable& ranges = reader.ranges();
  std::int64_t found = 0;
  for (std::uint32_t other = 0; other < reader.block_count() && found < enough; ++other) {
    found += volume::IsActive(ranges.Get(reader.block_id(other)), isovalue) ? 1 : 0;
  }
  return found;
}

// Returns a block to ask the tree for. The candidates are the first block of the shard, and some
// others that lie far apart, that an isovalue finds. The one whose greatest value finds the fewest
// blocks is taken. Not set: no isovalue finds any block. O(blocks), in memory. Errors are those of
// ShardReader::SpanOf.
absl::StatusOr<std::optional<std::uint32_t>> BlockToAskFor(const store::ShardReader& reader) {
  std::optional<std::uint32_t> best;
  std::int64_t fewest = std::numeric_limits<std::int64_t>::max();
  const std::int64_t count = reader.block_count();
  const auto span_of = [&](std::int64_t ordinal) {
    return reader.SpanOf(reader.block_id(static_cast<std::uint32_t>(ordinal)));
  };
  const std::int64_t step = std::max<std::int64_t>(count / kCandidateCount, 1);
  std::int64_t begin = 0;
  while (begin < count) {
    std::int64_t ordinal = begin;
    ISOSCOPE_ASSIGN_OR_RETURN(volume::ScalarSpan span, span_of(ordinal));
    while (ordinal + 1 < count && (!std::isfinite(span.max) || !volume::IsActive(span, span.max))) {
      ISOSCOPE_ASSIGN_OR_RETURN(span, span_of(++ordinal));
    }
    if (!std::isfinite(span.max) || !volume::IsActive(span, span.max)) {
      break;  // nor does any behind it
    }
    const std::int64_t found = CountFound(reader, span.max, fewest);
    if (!best.has_value() || found < fewest) {
      best = static_cast<std::uint32_t>(ordinal);
      fewest = found;
    }
    begin = std::max(begin + step, ordinal + 1);
  }
  return best;
}

// Checks that the tree belongs to the shard's blocks. The trees of two shards can agree in size and
// head. But a block is in one shard only. So any answer of another shard's tree names blocks that
// do not have these ordinals, and lacks those that do.
absl::Status CheckTreeIsOfBlocks(const Shard& shard, const std::string& tree_path) {
  const store::ShardReader& reader = *shard.reader;
  ISOSCOPE_ASSIGN_OR_RETURN(const std::optional<std::uint32_t> ordinal, BlockToAskFor(reader));
  if (!ordinal.has_value()) {
    return absl::OkStatus();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::ScalarSpan span,
                            reader.SpanOf(reader.block_id(*ordinal)));
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
    has_block = has_block || interval.ordinal == *ordinal;
  }
  if (!has_block) {
    return absl::DataLossError(absl::StrFormat(
        "%s: lacks block %d at place %d: it is of another shard; copy the whole shard directory "
        "again",
        tree_path, reader.block_id(*ordinal), *ordinal));
  }
  return absl::OkStatus();
}

// Opens the tree beside the tables.
absl::StatusOr<std::shared_ptr<Shard>> WithTree(std::unique_ptr<store::ShardReader> reader,
                                                std::uint32_t number,
                                                const store::OpenFile& open_file) {
  auto shard = std::make_shared<Shard>();
  shard->number = number;
  shard->reader = std::move(reader);
  shard->shapes = std::make_shared<const extract::BlockShapes>(shard->reader->layout());
  const std::string tree_path = shard->reader->directory() + "/" + store::kIntervalTreeFileName;
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<io::RandomAccessFile> file, open_file(tree_path));
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

// Returns true if an error is of the files of a level: without it, others can be served.
bool IsOfLevel(const absl::Status& status) {
  return absl::IsFailedPrecondition(status) || absl::IsDataLoss(status) || absl::IsNotFound(status);
}

}  // namespace

std::uint32_t NextShardNumber() {
  static std::atomic<std::uint32_t> next_number{0};
  return next_number.fetch_add(1);
}

absl::StatusOr<std::shared_ptr<const Shard>> OpenShard(const std::string& directory,
                                                       std::uint32_t number,
                                                       const store::OpenFile& open_file,
                                                       const store::OpenSamples& open_samples) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<store::ShardReader> reader,
                            store::ShardReader::Open(directory, open_file, open_samples));
  return WithTree(std::move(reader), number, open_file);
}

absl::StatusOr<std::shared_ptr<const Shard>> OpenLevel(const Shard& shard, int level,
                                                       std::uint32_t number,
                                                       const store::OpenFile& open_file) {
  absl::StatusOr<std::unique_ptr<store::ShardReader>> reader =
      store::OpenLevelOf(*shard.reader, level, open_file);
  if (absl::IsNotFound(reader.status())) {
    return absl::FailedPreconditionError(reader.status().message());
  }
  ISOSCOPE_RETURN_IF_ERROR(reader.status());
  return WithTree(*std::move(reader), number, open_file);
}

absl::StatusOr<std::shared_ptr<const Shard>> OpenShardWithLevels(
    const std::string& directory, const store::OpenFile& open_file,
    const store::OpenSamples& open_samples) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<store::ShardReader> reader,
                            store::ShardReader::Open(directory, open_file, open_samples));
  ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<Shard> shard,
                            WithTree(std::move(reader), NextShardNumber(), open_file));
  for (int level = 1; level <= shard->reader->manifest().highest_level(); ++level) {
    absl::StatusOr<std::shared_ptr<const Shard>> opened =
        OpenLevel(*shard, level, NextShardNumber(), open_file);
    if (!opened.ok() && !IsOfLevel(opened.status())) {
      return opened.status();
    }
    if (!opened.ok()) {
      base::LogWarning(
          "shard_lacks_level",
          {{"directory", base::OwnText{directory}}, {"level", level}, {"status", opened.status()}});
    }
    shard->levels.push_back(opened.ok() ? *std::move(opened) : nullptr);
  }
  return std::shared_ptr<const Shard>(std::move(shard));
}

}  // namespace isoscope::agent
