#include "partition-agent/supply/block_reads.h"

#include <algorithm>

#include "core/base/status_macros.h"

namespace isoscope::agent {

BlockReads::BlockReads(const Shards& shards, const std::vector<BlockToRead>& blocks) {
  for (std::size_t begin = 0; begin < blocks.size();) {
    OfShard of{.reader = shards[blocks[begin].shard_index]->reader.get(),
               .ordinals = {},
               .disk_runs = {},
               .first_block = begin,
               .first_read = reads_.size()};
    std::size_t end = begin;
    for (; end < blocks.size() && blocks[end].shard_index == blocks[begin].shard_index; ++end) {
      of.ordinals.push_back(blocks[end].ordinal);
    }
    of.disk_runs = of.reader->PlanDiskRuns(of.ordinals);
    for (const store::ShardReader::DiskRun& disk_run : of.disk_runs) {
      read_bytes_ += disk_run.size;
      reads_.push_back(of.reader->RequestFor(disk_run));
    }
    shards_.push_back(std::move(of));
    begin = end;
  }
  visited_.resize(reads_.size());
}

absl::Status BlockReads::ForEach(const AgentResources& resources,
                                 const base::Cancellation& cancellation, Visit visit,
                                 const Pauses& pauses) {
  ReadWatch watch{.trace = resources.trace, .frames = resources.frames};
  if (AgentMetrics* const metrics = resources.metrics; metrics != nullptr) {
    metrics->reads.Add(static_cast<std::int64_t>(reads_.size()));
    metrics->read_bytes.Add(read_bytes_);
    watch.wait = &metrics->read_wait;
  }
  // A far source is read by many threads; a ring reads by one what is no file.
  const bool is_index_only = std::any_of(
      shards_.begin(), shards_.end(), [](const OfShard& of) { return of.reader->is_index_only(); });
  io::ReadQueue queue(std::move(reads_), {.backend = is_index_only ? io::ReadBackend::kThreads
                                                                   : io::ReadBackend::kAutomatic,
                                          .max_bytes = resources.max_read_bytes});
  return ForEachArrival(
      &queue, resources.arena, cancellation,
      [&](const io::ReadQueue::Arrival& arrival) { return VisitArrival(arrival, visit, pauses); },
      pauses, watch);
}

// Visits the blocks of an arrival that were not visited yet, until a pause is due.
absl::StatusOr<ArrivalWork> BlockReads::VisitArrival(const io::ReadQueue::Arrival& arrival,
                                                     Visit visit, const Pauses& pauses) {
  const OfShard& of = *(std::upper_bound(shards_.begin(), shards_.end(), arrival.index(),
                                         [](std::size_t read, const OfShard& shard) {
                                           return read < shard.first_read;
                                         }) -
                        1);
  std::size_t& visited = visited_[arrival.index()];
  store::ShardReader::DiskRun rest = of.disk_runs[arrival.index() - of.first_read];
  const std::size_t run_end = rest.first + rest.count;  // of the shard's ordinals
  rest.first += visited;
  rest.count -= visited;
  std::size_t next = rest.first;
  bool is_paused = false;
  absl::Status status = of.reader->VisitDiskRun(
      rest, of.ordinals, arrival.status(), arrival.data(),
      [&](const volume::BlockSamples& samples) {
        const std::size_t block = of.first_block + next++;
        ++visited;
        ISOSCOPE_RETURN_IF_ERROR(visit(block, samples));
        is_paused = next < run_end && pauses.is_due();
        return is_paused ? absl::AbortedError("a pause is due") : absl::OkStatus();
      });
  if (is_paused) {
    return ArrivalWork::kPaused;
  }
  ISOSCOPE_RETURN_IF_ERROR(std::move(status));
  return ArrivalWork::kDone;
}

}  // namespace isoscope::agent
