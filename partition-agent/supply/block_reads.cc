#include "partition-agent/supply/block_reads.h"

#include <algorithm>
#include <memory>
#include <optional>

#include "core/base/cancellation.h"
#include "core/base/status_macros.h"
#include "core/math/z_order.h"
#include "core/store/sample_reader.h"

namespace isoscope::agent {

BlockReads::BlockReads(const Shards& shards, const std::vector<BlockToRead>& blocks) {
  for (std::size_t begin = 0; begin < blocks.size();) {
    OfShard of{.reader = shards[blocks[begin].shard_index]->reader.get(),
               .ordinals = {},
               .first_block = begin};
    std::size_t end = begin;
    for (; end < blocks.size() && blocks[end].shard_index == blocks[begin].shard_index; ++end) {
      of.ordinals.push_back(blocks[end].ordinal);
    }
    for (const store::ShardReader::DiskRun& disk_run : of.reader->PlanDiskRuns(of.ordinals)) {
      read_bytes_ += disk_run.size;
      runs_.push_back({.of = shards_.size(), .disk_run = disk_run});
    }
    is_index_only_ = of.reader->is_index_only();  // so are all shards of a volume
    shards_.push_back(std::move(of));
    begin = end;
  }
  if (is_index_only_) {
    SortByUnits();
  }
}

// What is in memory comes first, before other units take its place.
void BlockReads::SortByUnits() {
  std::vector<std::pair<bool, Run>> runs;  // whether the unit must be read
  runs.reserve(runs_.size());
  for (Run& run : runs_) {
    const OfShard& of = shards_[run.of];
    const store::SampleReader& samples = *of.reader->samples();
    run.unit = samples.UnitOf(of.reader->block_id(of.ordinals[run.disk_run.first]));
    runs.emplace_back(!samples.HasUnit(run.unit), run);
  }
  std::stable_sort(runs.begin(), runs.end(), [](const auto& a, const auto& b) {
    return a.first != b.first ? b.first : math::IsBeforeInZOrder(a.second.unit, b.second.unit);
  });
  std::transform(runs.begin(), runs.end(), runs_.begin(),
                 [](const auto& run) { return run.second; });
}

// Returns the units of a far source in the order in which the runs need them, each once.
std::vector<UnitReadAhead::Unit> BlockReads::PlanUnitsAhead() {
  std::vector<UnitReadAhead::Unit> units;
  bool is_any_missing = false;
  for (Run& run : runs_) {
    const store::SampleReader* const samples = shards_[run.of].reader->samples();
    if (samples->is_local()) {
      return {};
    }
    if (units.empty() || !(units.back().index == run.unit)) {
      is_any_missing = is_any_missing || !samples->HasUnit(run.unit);
      units.push_back({.reader = samples, .index = run.unit});
    }
    run.unit_count_before = units.size() - 1;
  }
  return is_any_missing ? units : std::vector<UnitReadAhead::Unit>();
}

absl::Status BlockReads::ForEach(const AgentResources& resources,
                                 const base::Cancellation& cancellation, Visit visit,
                                 const Pauses& pauses) {
  ReadWatch watch{.trace = resources.trace, .frames = resources.frames};
  if (AgentMetrics* const metrics = resources.metrics; metrics != nullptr) {
    metrics->reads.Add(static_cast<std::int64_t>(runs_.size()));
    metrics->read_bytes.Add(read_bytes_);
    watch.wait = &metrics->read_wait;
  }
  // Reads of a source end with the frame, and after an error.
  base::Cancellation reads_end(cancellation.deadline());
  const base::Cancellation::Callback frame_ends(cancellation, [&] { reads_end.Cancel(); });
  std::optional<UnitReadAhead> ahead;
  std::vector<std::unique_ptr<io::RandomAccessFile>> files;  // of index-only shards
  if (is_index_only_) {
    ahead.emplace(PlanUnitsAhead(), reads_end);
    for (const OfShard& of : shards_) {
      files.push_back(of.reader->OpenSourceBlocks(reads_end));
    }
  }
  std::vector<io::ReadQueue::Read> reads;
  reads.reserve(runs_.size());
  for (const Run& run : runs_) {
    reads.push_back(shards_[run.of].reader->RequestFor(run.disk_run));
    if (is_index_only_) {
      reads.back().file = files[run.of].get();
    }
  }
  // A far source is read by many threads; a ring reads by one what is no file.
  io::ReadQueue queue(std::move(reads), {.backend = is_index_only_ ? io::ReadBackend::kThreads
                                                                   : io::ReadBackend::kAutomatic,
                                         .max_bytes = resources.max_read_bytes});
  absl::Status status = ForEachArrival(
      &queue, resources.arena, cancellation,
      [&](const io::ReadQueue::Arrival& arrival) {
        if (ahead.has_value()) {
          ahead->HasUsed(runs_[arrival.index()].unit_count_before);
        }
        return VisitArrival(arrival, visit, pauses);
      },
      pauses, watch);
  if (!status.ok()) {
    reads_end.Cancel();
  }
  return status;
}

// Visits the blocks of an arrival that were not visited yet, until a pause is due.
absl::StatusOr<ArrivalWork> BlockReads::VisitArrival(const io::ReadQueue::Arrival& arrival,
                                                     Visit visit, const Pauses& pauses) {
  Run& run = runs_[arrival.index()];
  const OfShard& of = shards_[run.of];
  store::ShardReader::DiskRun rest = run.disk_run;
  const std::size_t run_end = rest.first + rest.count;  // of the shard's ordinals
  rest.first += run.visited_count;
  rest.count -= run.visited_count;
  std::size_t next = rest.first;
  bool is_paused = false;
  absl::Status status = of.reader->VisitDiskRun(
      rest, of.ordinals, arrival.status(), arrival.data(),
      [&](const volume::BlockSamples& samples) {
        const std::size_t block = of.first_block + next++;
        ++run.visited_count;
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
