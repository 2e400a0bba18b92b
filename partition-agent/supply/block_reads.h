// Reads chosen blocks of shards from disk and visits their samples.

#ifndef ISOSCOPE_PARTITION_AGENT_SUPPLY_BLOCK_READS_H_
#define ISOSCOPE_PARTITION_AGENT_SUPPLY_BLOCK_READS_H_

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/io/read_queue.h"
#include "core/volume/block_samples.h"
#include "partition-agent/memory/agent_resources.h"
#include "partition-agent/memory/queued_reads.h"
#include "partition-agent/shard/shard.h"
#include "partition-agent/supply/unit_read_ahead.h"

namespace isoscope::agent {

// A block to read, by its shard's index in the list of shards.
struct BlockToRead {
  std::uint32_t shard_index = 0;
  std::uint32_t ordinal = 0;

  friend bool operator==(const BlockToRead&, const BlockToRead&) = default;
  friend bool operator<(const BlockToRead& a, const BlockToRead& b) {
    return std::pair(a.shard_index, a.ordinal) < std::pair(b.shard_index, b.ordinal);
  }
};

// The disk runs of some blocks. For a single use, by one thread. Those of index-only shards are read
// so that a unit of the source is used while it is in memory: what is there at first, then the rest in
// the z-order of units. Those of a far source are read ahead (unit_read_ahead.h).
class BlockReads {
 public:
  // shards: outlive it
  // blocks: ascending, each once
  BlockReads(const Shards& shards, const std::vector<BlockToRead>& blocks);

  [[nodiscard]] std::int64_t read_bytes() const { return read_bytes_; }

  // Visits each block once, by its index in `blocks`, on several threads of the arena at once.
  // Updates resources.metrics and resources.trace. Errors: DATA_LOSS as ShardReader::VisitDiskRun;
  // else as ForEachArrival. Blocks.
  using Visit = absl::FunctionRef<absl::Status(std::size_t, const volume::BlockSamples&)>;
  absl::Status ForEach(const AgentResources& resources, const base::Cancellation& cancellation,
                       Visit visit, const Pauses& pauses = {});

 private:
  struct OfShard {
    const store::ShardReader* reader = nullptr;
    std::vector<std::uint32_t> ordinals;
    std::size_t first_block = 0;  // of its ordinals, in `blocks`
  };
  struct Run {
    std::size_t of = 0;  // in shards_
    store::ShardReader::DiskRun disk_run;
    std::size_t visited_count = 0;      // blocks
    math::Index3 unit{0, 0, 0};         // of an index-only shard
    std::size_t unit_count_before = 0;  // that are read ahead for the runs before it
  };

  void SortByUnits();
  std::vector<UnitReadAhead::Unit> PlanUnitsAhead();
  absl::StatusOr<ArrivalWork> VisitArrival(const io::ReadQueue::Arrival& arrival, Visit visit,
                                           const Pauses& pauses);

  std::vector<OfShard> shards_;
  std::vector<Run> runs_;  // in the order of their reads
  std::int64_t read_bytes_ = 0;
  bool is_index_only_ = false;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_SUPPLY_BLOCK_READS_H_
