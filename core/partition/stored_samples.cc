// A portion's blocks store all samples of its slab, ghosts included, so each block is read in one
// portion alone. Disk runs are read, verified and copied by several threads. Each sample of the slab
// is copied from one block, so the samples do not depend on the threads.

#include "core/partition/stored_samples.h"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstring>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/types/span.h"
#include "oneapi/tbb/blocked_range.h"
#include "oneapi/tbb/parallel_for.h"
#include "oneapi/tbb/partitioner.h"

#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/math/box.h"
#include "core/volume/scalar_type.h"

namespace isoscope::partition {
namespace {

// An entry of an open shard, and an ordinal of a portion.
constexpr std::int64_t kBytesPerBlock = 24 + 4;

std::size_t PortionOf(const volume::BlockLayout& layout, const PartitionPlan& plan,
                      volume::BlockId id) {
  const math::Index3 index = layout.IndexOf(id);
  const std::int64_t bands =
      (layout.block_dims().y + plan.block_rows_per_portion - 1) / plan.block_rows_per_portion;
  return static_cast<std::size_t>(index.z / plan.layers_per_portion * bands +
                                  index.y / plan.block_rows_per_portion);
}

// Disk runs that are read at the same time, each into a buffer of its own.
constexpr std::size_t kReaderCount = 4;

// The samples that a block contributes to the slab of its portion: those of its own cells, and at
// the border of the portion all that it stores. So no two blocks write the same sample.
math::IndexBox SamplesFrom(const volume::BlockLayout& layout, volume::BlockId id,
                           const math::IndexBox& portion_blocks) {
  const math::Index3 index = layout.IndexOf(id);
  const math::IndexBox cells = layout.CellsOf(id);
  math::IndexBox samples = layout.StoredSamplesOf(id);
  for (int axis = 0; axis < 3; ++axis) {
    if (index[axis] > portion_blocks.begin[axis]) {
      samples.begin[axis] = cells.begin[axis];
    }
    if (index[axis] + 1 < portion_blocks.end[axis]) {
      samples.end[axis] = cells.end[axis];
    }
  }
  return samples;
}

// A slab in the making: the samples `box` of the blocks `blocks`.
struct OpenSlab {
  math::IndexBox blocks;
  math::IndexBox box;
  char* samples = nullptr;
};

// Copies what a block contributes. Calls for different blocks may run at the same time.
void CopyBlock(const volume::BlockLayout& layout, const volume::BlockSamples& block,
               const OpenSlab& slab) {
  const math::IndexBox stored = layout.StoredSamplesOf(block.block_id);
  const math::IndexBox copied = SamplesFrom(layout, block.block_id, slab.blocks);
  const auto offset = [&](const math::IndexBox& box, std::int64_t y, std::int64_t z) {
    const math::Index3 dims = box.dims();
    const std::int64_t sample =
        ((z - box.begin.z) * dims.y + y - box.begin.y) * dims.x + copied.begin.x - box.begin.x;
    return sample * static_cast<std::int64_t>(volume::SizeOf(block.type));
  };
  const std::size_t row_bytes =
      static_cast<std::size_t>(copied.dims().x) * volume::SizeOf(block.type);
  for (std::int64_t z = copied.begin.z; z < copied.end.z; ++z) {
    for (std::int64_t y = copied.begin.y; y < copied.end.y; ++y) {
      std::memcpy(slab.samples + offset(slab.box, y, z), block.bytes + offset(stored, y, z),
                  row_bytes);
    }
  }
}

// A disk run of a shard, with the ordinals of its plan.
struct ShardRun {
  const store::ShardReader* shard = nullptr;
  store::ShardReader::DiskRun run;
  absl::Span<const std::uint32_t> ordinals;
};

// Reads runs into a slab, several at the same time. Returns an error of the first run that has one,
// of those that were read.
absl::Status ReadRuns(const std::vector<ShardRun>& runs, const volume::BlockLayout& layout,
                      const OpenSlab& slab, const base::Cancellation& cancellation,
                      std::vector<std::vector<char>>* buffers) {
  struct Reader {
    absl::Status status;
    std::size_t failed_run = 0;
  };
  std::vector<Reader> readers(buffers->size());
  std::atomic<std::size_t> next{0};
  std::atomic<bool> has_failed{false};
  const auto read = [&](std::size_t i) {
    std::vector<char>& buffer = (*buffers)[i];
    for (std::size_t at = next++; at < runs.size() && !has_failed; at = next++) {
      const ShardRun& run = runs[at];
      absl::Status status = cancellation.Check();
      if (status.ok()) {
        buffer.resize(std::max(buffer.size(), static_cast<std::size_t>(run.run.size)));
        status = run.shard->ReadDiskRun(run.run, run.ordinals, buffer.data(),
                                        [&](const volume::BlockSamples& block) {
                                          CopyBlock(layout, block, slab);
                                          return absl::OkStatus();
                                        });
      }
      if (!status.ok()) {
        has_failed = true;
        readers[i] = {std::move(status), at};
        return;
      }
    }
  };
  // One task for each reader, however few threads there are.
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, readers.size(), 1),
      [&](const tbb::blocked_range<std::size_t>& range) {
        for (std::size_t i = range.begin(); i < range.end(); ++i) {
          read(i);
        }
      },
      tbb::simple_partitioner());
  const auto first =
      std::min_element(readers.begin(), readers.end(), [](const Reader& a, const Reader& b) {
        return std::pair(a.status.ok(), a.failed_run) < std::pair(b.status.ok(), b.failed_run);
      });
  return first->status;
}

}  // namespace

absl::StatusOr<std::unique_ptr<StoredSamples>> StoredSamples::Open(
    const std::vector<std::string>& shard_directories, const store::OpenSamples& open_samples) {
  std::unique_ptr<StoredSamples> samples(new StoredSamples);
  for (const std::string& directory : shard_directories) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        std::unique_ptr<store::ShardReader> shard,
        store::ShardReader::Open(directory, io::OpenRandomAccessFile, open_samples));
    const store::ShardReader& first = samples->shards_.empty() ? *shard : *samples->shards_.front();
    const auto expected_index = static_cast<int>(samples->shards_.size());
    if (shard->manifest_crc32c() != first.manifest_crc32c() ||
        shard->shard_index() != expected_index ||
        shard->manifest().shards.size() != shard_directories.size()) {
      return absl::DataLossError(absl::StrFormat(
          "%s: holds shard %d of %d of dataset id %s, expected shard %d of %d of %s: files are "
          "mixed",
          directory, shard->shard_index(), shard->manifest().shards.size(),
          shard->manifest().dataset_id, expected_index, shard_directories.size(),
          first.manifest().dataset_id));
    }
    samples->shards_.push_back(std::move(shard));
  }
  return samples;
}

std::int64_t StoredSamples::MemoryBytes(const volume::BlockLayout& layout,
                                        volume::ScalarType type) {
  return layout.block_count() *
             (kBytesPerBlock + 2 * static_cast<std::int64_t>(volume::SizeOf(type))) +
         static_cast<std::int64_t>(kReaderCount) * store::ShardReader::kMaxDiskRunBytes;
}

StoredSamples::Ordinals StoredSamples::OrdinalsOf(const store::ShardReader& shard,
                                                  const PartitionPlan& plan) {
  const volume::BlockLayout& layout = shard.layout();
  Ordinals found;
  found.ends.resize(static_cast<std::size_t>(PortionCount(layout, plan)));
  const auto count = static_cast<std::uint32_t>(shard.block_count());
  for (std::uint32_t ordinal = 0; ordinal < count; ++ordinal) {
    ++found.ends[PortionOf(layout, plan, shard.block_id(ordinal))];
  }
  std::uint32_t begin = 0;  // `ends` has the begins until the ordinals are in their places
  for (std::uint32_t& end : found.ends) {
    begin += std::exchange(end, begin);
  }
  found.ordinals.resize(count);
  for (std::uint32_t ordinal = 0; ordinal < count; ++ordinal) {
    found.ordinals[found.ends[PortionOf(layout, plan, shard.block_id(ordinal))]++] = ordinal;
  }
  return found;
}

absl::Status StoredSamples::ForEachPortion(
    const PartitionPlan& plan, absl::FunctionRef<absl::Status(const Slab&, const Portion&)> visit,
    const base::Cancellation& cancellation) {
  std::vector<Ordinals> by_shard;
  by_shard.reserve(shards_.size());
  for (const std::unique_ptr<store::ShardReader>& shard : shards_) {
    by_shard.push_back(OrdinalsOf(*shard, plan));
  }
  std::vector<char> samples(static_cast<std::size_t>(plan.portion_bytes));
  std::vector<std::vector<char>> buffers(kReaderCount);
  std::vector<ShardRun> runs;
  const std::int64_t portion_count = PortionCount(layout(), plan);
  for (std::int64_t i = 0; i < portion_count; ++i) {
    const Portion portion = PortionAt(layout(), plan, i);
    const OpenSlab slab{.blocks = BlocksOfPortion(layout(), portion),
                        .box = SamplesOfPortion(layout(), portion),
                        .samples = samples.data()};
    const auto at = static_cast<std::size_t>(i);
    runs.clear();
    for (std::size_t k = 0; k < shards_.size(); ++k) {
      const std::uint32_t begin = i == 0 ? 0 : by_shard[k].ends[at - 1];
      const auto ordinals =
          absl::MakeConstSpan(by_shard[k].ordinals).subspan(begin, by_shard[k].ends[at] - begin);
      for (const store::ShardReader::DiskRun& run : shards_[k]->PlanDiskRuns(ordinals)) {
        runs.push_back({.shard = shards_[k].get(), .run = run, .ordinals = ordinals});
      }
    }
    ISOSCOPE_RETURN_IF_ERROR(ReadRuns(runs, layout(), slab, cancellation, &buffers));
    ISOSCOPE_RETURN_IF_ERROR(visit({.samples = slab.samples,
                                    .begin_z = slab.box.begin.z,
                                    .begin_y = slab.box.begin.y,
                                    .rows = slab.box.end.y - slab.box.begin.y},
                                   portion));
  }
  return absl::OkStatus();
}

}  // namespace isoscope::partition
