// The shards of a dataset while they are written. Internal to the partitioner, whose tests cover
// it; the steps are at the head of partitioner.cc.

#ifndef ISOSCOPE_CORE_PARTITION_SHARD_SET_H_
#define ISOSCOPE_CORE_PARTITION_SHARD_SET_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/io/external_sorter.h"
#include "core/partition/block_batch.h"
#include "core/partition/histogram_builder.h"
#include "core/partition/partition_plan.h"
#include "core/store/manifest.h"
#include "core/store/part_file.h"
#include "core/store/sample_reader.h"
#include "core/store/shard_format.h"
#include "core/store/shard_writer.h"
#include "core/volume/block_layout.h"
#include "core/volume/scalar_span.h"
#include "core/volume/scalar_type.h"

namespace isoscope::partition {

// in_source: of an index-only volume, whose blocks are overhangs, whatever `encoding` is.
// Thread-compatible: Create, then Write for each batch, then Finish. References must outlive it.
class ShardSet {
 public:
  ShardSet(const std::string& directory, const volume::BlockLayout& layout, volume::ScalarType type,
           const PartitionPlan& plan, store::BlockEncoding encoding,
           const std::optional<store::SourceSamples>& in_source = std::nullopt);

  // Creates the folders and the files of blocks. is_direct: past the page cache, if the plan's
  // buffers are large enough for that
  absl::Status Create(int shard_count, bool is_direct);
  // Encodes and writes the blocks of a batch that was cut, those of a shard by one thread in the
  // order of its file, so that neighbours are written together. The batch's bytes are lost.
  absl::Status Write(BlockBatch* batch);
  // Step 4 writes the indices of all shards. Returns a summary of each.
  absl::StatusOr<std::vector<store::ShardSummary>> Finish(const HistogramBuilder& histograms,
                                                          const base::Cancellation& cancellation);

  // The same for the blocks of one slab: without the interval tree, which the whole shard has, but
  // with spans.bin. A shard without blocks loses its folder.
  absl::StatusOr<std::vector<store::ShardPiece>> FinishPieces(
      const HistogramBuilder& histograms, const base::Cancellation& cancellation);

  [[nodiscard]] const std::vector<std::string>& directories() const { return directories_; }

 private:
  // A block's data for the block index and the interval tree of its shard. Sorted by shard and
  // ordinal.
  struct Entry {
    volume::ScalarSpan span;
    std::int64_t offset = 0;  // where ShardWriter has put it
    std::uint32_t size = 0;
    std::uint32_t crc32c = 0;
    volume::BlockId id = 0;
    std::uint32_t ordinal = 0;
    std::uint16_t shard = 0;
    std::uint16_t encoding = 0;

    friend bool operator<(const Entry& a, const Entry& b) {
      return std::tie(a.shard, a.ordinal) < std::tie(b.shard, b.ordinal);
    }
  };
  static_assert(sizeof(Entry) == kEntryBytesPerBlock);

  // Put the encoded blocks of a batch in place of their samples.
  void EncodeBlocks(BlockBatch* batch) const;
  // Write blocks [begin, end) of a batch, all of one shard, and fill in their entries.
  absl::Status WriteOfShard(std::size_t begin, std::size_t end, BlockBatch* batch);
  absl::Status AppendToShard(std::size_t begin, std::size_t end, BlockBatch* batch);
  static store::BlockIndexEntry IndexEntryOf(const Entry& entry);
  absl::StatusOr<store::ShardPiece> FinishPiece(std::size_t shard,
                                                const HistogramBuilder& histograms,
                                                const base::Cancellation& cancellation);
  absl::StatusOr<store::ShardSummary> FinishShard(std::size_t shard,
                                                  const HistogramBuilder& histograms,
                                                  const base::Cancellation& cancellation);

  const std::string directory_;
  const volume::BlockLayout& layout_;
  const volume::ScalarType type_;
  const PartitionPlan& plan_;
  const store::BlockEncoding encoding_;  // kOverhang if the samples are in the source
  const std::optional<store::SourceSamples> in_source_;
  std::vector<std::string> directories_;
  std::vector<std::unique_ptr<store::ShardWriter>> writers_;
  io::ExternalSorter<Entry> entries_;
};

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_SHARD_SET_H_
