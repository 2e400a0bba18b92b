// A portion's blocks store all samples of its slab, ghosts included, so each block is read in one
// portion alone. Samples that several blocks store are equal; the last one that is copied stays.

#include "core/partition/stored_samples.h"

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/types/span.h"

#include "core/base/status_macros.h"
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

// Copies the stored samples of a block into the slab of `box`.
void CopyBlock(const volume::BlockLayout& layout, const volume::BlockSamples& block,
               const math::IndexBox& box, char* slab) {
  const math::IndexBox stored = layout.StoredSamplesOf(block.block_id);
  const auto sample_size = static_cast<std::int64_t>(volume::SizeOf(block.type));
  const std::int64_t row_bytes = stored.dims().x * sample_size;
  const math::Index3 dims = box.dims();
  const char* row = block.bytes;
  for (std::int64_t z = stored.begin.z; z < stored.end.z; ++z) {
    for (std::int64_t y = stored.begin.y; y < stored.end.y; ++y, row += row_bytes) {
      const std::int64_t at =
          ((z - box.begin.z) * dims.y + y - box.begin.y) * dims.x + stored.begin.x - box.begin.x;
      std::memcpy(slab + at * sample_size, row, static_cast<std::size_t>(row_bytes));
    }
  }
}

}  // namespace

absl::StatusOr<std::unique_ptr<StoredSamples>> StoredSamples::Open(
    const std::vector<std::string>& shard_directories) {
  std::unique_ptr<StoredSamples> samples(new StoredSamples);
  for (const std::string& directory : shard_directories) {
    ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<store::ShardReader> shard,
                              store::ShardReader::Open(directory));
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
         store::ShardReader::kMaxDiskRunBytes;
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
  std::vector<char> slab(static_cast<std::size_t>(plan.portion_bytes));
  std::vector<char> run_bytes;
  const std::int64_t portion_count = PortionCount(layout(), plan);
  for (std::int64_t i = 0; i < portion_count; ++i) {
    const Portion portion = PortionAt(layout(), plan, i);
    const math::IndexBox box = SamplesOfPortion(layout(), portion);
    const auto at = static_cast<std::size_t>(i);
    for (std::size_t k = 0; k < shards_.size(); ++k) {
      const std::uint32_t begin = i == 0 ? 0 : by_shard[k].ends[at - 1];
      const auto ordinals =
          absl::MakeConstSpan(by_shard[k].ordinals).subspan(begin, by_shard[k].ends[at] - begin);
      for (const store::ShardReader::DiskRun& run : shards_[k]->PlanDiskRuns(ordinals)) {
        ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
        run_bytes.resize(std::max(run_bytes.size(), static_cast<std::size_t>(run.size)));
        const auto copy = [&](const volume::BlockSamples& block) {
          CopyBlock(layout(), block, box, slab.data());
          return absl::OkStatus();
        };
        ISOSCOPE_RETURN_IF_ERROR(shards_[k]->ReadDiskRun(run, ordinals, run_bytes.data(), copy));
      }
    }
    ISOSCOPE_RETURN_IF_ERROR(visit({.samples = slab.data(),
                                    .begin_z = box.begin.z,
                                    .begin_y = box.begin.y,
                                    .rows = box.end.y - box.begin.y},
                                   portion));
  }
  return absl::OkStatus();
}

}  // namespace isoscope::partition
