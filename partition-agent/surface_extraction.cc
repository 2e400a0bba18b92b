#include "partition-agent/surface_extraction.h"

#include <algorithm>
#include <cstdint>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/types/span.h"
#include <oneapi/tbb/enumerable_thread_specific.h>

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/extract/block_extractor.h"
#include "core/index/interval_tree.h"
#include "core/io/read_queue.h"
#include "core/store/shard_reader.h"
#include "core/volume/block_samples.h"
#include "partition-agent/queued_reads.h"

namespace isoscope::agent {
namespace {

// An active block, and where it lies.
struct ActiveBlock {
  volume::BlockId block_id = 0;
  std::uint32_t ordinal = 0;
  std::size_t shard_slot = 0;
};

// One read request of a batch: part of the ordinals of one shard.
struct ReadTask {
  std::size_t shard_slot = 0;
  store::ShardReader::Run run;
};

}  // namespace

class SurfaceExtraction::Impl {
 public:
  Impl(std::vector<std::shared_ptr<const Shard>> shards, double isovalue, tbb::task_arena* arena,
       std::size_t max_read_bytes, const base::Cancellation* cancellation)
      : shards_(std::move(shards)),
        isovalue_(isovalue),
        arena_(arena),
        max_read_bytes_(max_read_bytes),
        cancellation_(cancellation),
        extractors_([this] {
          const Shard& shard = *shards_.front();
          return extract::BlockExtractor(shard.reader->manifest().geometry, shard.reader->layout(),
                                         shard.shapes);
        }) {}

  absl::Status QueryTrees() {
    for (std::size_t slot = 0; slot < shards_.size(); ++slot) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation_->Check());
      ISOSCOPE_ASSIGN_OR_RETURN(const index::QueryResult result,
                                shards_[slot]->tree->Query(isovalue_));
      for (const index::BlockInterval& interval : result.active) {
        active_.push_back({interval.block_id, interval.ordinal, slot});
      }
    }
    std::sort(active_.begin(), active_.end(),
              [](const ActiveBlock& a, const ActiveBlock& b) { return a.block_id < b.block_id; });
    return absl::OkStatus();
  }

  absl::StatusOr<std::vector<mesh::BlockMesh>> NextBatch() {
    std::vector<mesh::BlockMesh> meshes;
    // A batch can be all empty meshes: active blocks need not have triangles (NaN).
    while (meshes.empty() && next_ < active_.size()) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation_->Check());
      const absl::Span<const ActiveBlock> batch = TakeBatch();
      ISOSCOPE_ASSIGN_OR_RETURN(meshes, ExtractBatch(batch));
      meshes.erase(std::remove_if(meshes.begin(), meshes.end(),
                                  [](const mesh::BlockMesh& m) { return m.indices.empty(); }),
                   meshes.end());
    }
    return meshes;
  }

 private:
  absl::Span<const ActiveBlock> TakeBatch() {
    const store::ShardReader& reader = *shards_.front()->reader;
    const std::size_t begin = next_;
    std::size_t sample_bytes = 0;
    while (next_ < active_.size() && next_ - begin < kMaxBatchBlocks &&
           (next_ == begin || sample_bytes < kMaxBatchSampleBytes)) {
      sample_bytes += volume::StoredSizeBytes(reader.layout(), active_[next_].block_id,
                                              reader.manifest().scalar_type);
      ++next_;
    }
    return absl::MakeConstSpan(active_).subspan(begin, next_ - begin);
  }

  absl::StatusOr<std::vector<mesh::BlockMesh>> ExtractBatch(absl::Span<const ActiveBlock> batch) {
    std::vector<std::vector<std::uint32_t>> ordinals(shards_.size());
    for (const ActiveBlock& block : batch) {
      ordinals[block.shard_slot].push_back(block.ordinal);
    }
    std::vector<ReadTask> tasks;
    for (std::size_t slot = 0; slot < shards_.size(); ++slot) {
      std::sort(ordinals[slot].begin(), ordinals[slot].end());
      for (const store::ShardReader::Run& run : shards_[slot]->reader->PlanRuns(ordinals[slot])) {
        tasks.push_back({slot, run});
      }
    }

    std::vector<io::ReadQueue::Read> reads;
    reads.reserve(tasks.size());
    for (const ReadTask& task : tasks) {
      reads.push_back(shards_[task.shard_slot]->reader->RequestFor(task.run));
    }

    std::vector<mesh::BlockMesh> meshes(batch.size());
    io::ReadQueue queue(std::move(reads), {.max_bytes = max_read_bytes_});
    ISOSCOPE_RETURN_IF_ERROR(
        ForEachArrival(&queue, arena_, *cancellation_, [&](const io::ReadQueue::Arrival& arrival) {
          const ReadTask& task = tasks[arrival.index()];
          return ExtractRun(task, ordinals[task.shard_slot], arrival, batch, &meshes);
        }));
    return meshes;
  }

  // Puts the meshes of a run's blocks at their places in `meshes`.
  absl::Status ExtractRun(const ReadTask& task, absl::Span<const std::uint32_t> ordinals,
                          const io::ReadQueue::Arrival& arrival,
                          absl::Span<const ActiveBlock> batch,
                          std::vector<mesh::BlockMesh>* meshes) {
    extract::BlockExtractor& extractor = extractors_.local();
    return shards_[task.shard_slot]->reader->VisitRun(
        task.run, ordinals, arrival.status(), arrival.data(),
        [&](const volume::BlockSamples& samples) -> absl::Status {
          ISOSCOPE_RETURN_IF_ERROR(cancellation_->Check());
          const auto* place = std::lower_bound(
              batch.begin(), batch.end(), samples.block_id,
              [](const ActiveBlock& block, volume::BlockId id) { return block.block_id < id; });
          if (place == batch.end() || place->block_id != samples.block_id) {
            return absl::DataLossError(absl::StrCat(
                "shard ", shards_[task.shard_slot]->reader->directory(), ": block ",
                samples.block_id, " was read, which the interval tree does not list as active"));
          }
          mesh::BlockMesh& mesh = (*meshes)[static_cast<std::size_t>(place - batch.begin())];
          extractor.ExtractWithEdgeKeys(samples, isovalue_, &mesh);
          return absl::OkStatus();
        });
  }

  const std::vector<std::shared_ptr<const Shard>> shards_;
  const double isovalue_;
  tbb::task_arena* const arena_;
  const std::size_t max_read_bytes_;
  const base::Cancellation* const cancellation_;
  std::vector<ActiveBlock> active_;
  std::size_t next_ = 0;
  tbb::enumerable_thread_specific<extract::BlockExtractor> extractors_;
};

SurfaceExtraction::SurfaceExtraction(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
SurfaceExtraction::~SurfaceExtraction() = default;

absl::StatusOr<std::unique_ptr<SurfaceExtraction>> SurfaceExtraction::Make(
    std::vector<std::shared_ptr<const Shard>> shards, double isovalue, tbb::task_arena* arena,
    std::size_t max_read_bytes, const base::Cancellation* cancellation) {
  ISOSCOPE_CHECK(!shards.empty());
  auto impl =
      std::make_unique<Impl>(std::move(shards), isovalue, arena, max_read_bytes, cancellation);
  ISOSCOPE_RETURN_IF_ERROR(impl->QueryTrees());
  return std::unique_ptr<SurfaceExtraction>(new SurfaceExtraction(std::move(impl)));
}

absl::StatusOr<std::vector<mesh::BlockMesh>> SurfaceExtraction::NextBatch() {
  return impl_->NextBatch();
}

}  // namespace isoscope::agent
