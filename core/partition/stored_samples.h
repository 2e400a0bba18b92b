// Reads back the samples of a volume from its shards, portion by portion.

#ifndef ISOSCOPE_CORE_PARTITION_STORED_SAMPLES_H_
#define ISOSCOPE_CORE_PARTITION_STORED_SAMPLES_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/partition/block_cutter.h"
#include "core/partition/partition_plan.h"
#include "core/store/manifest.h"
#include "core/store/sample_reader.h"
#include "core/store/shard_reader.h"
#include "core/volume/block_layout.h"

namespace isoscope::partition {

// All shards of a volume, open. Thread-compatible.
class StoredSamples {
 public:
  // Opens the shards. Errors as ShardReader::Open; DATA_LOSS: they are not of one volume.
  // open_samples: as for ShardReader::Open
  static absl::StatusOr<std::unique_ptr<StoredSamples>> Open(
      const std::vector<std::string>& shard_directories,
      const store::OpenSamples& open_samples = nullptr);

  // Memory of a volume of so many blocks, beside a portion.
  static std::int64_t MemoryBytes(const volume::BlockLayout& layout, volume::ScalarType type);

  // Visits all portions of a plan, each with the samples that its blocks store. Each block is read
  // once, and verified, on several threads; `visit` is called by this one. DATA_LOSS names the block.
  // An error of `visit` is returned at once.
  absl::Status ForEachPortion(const PartitionPlan& plan,
                              absl::FunctionRef<absl::Status(const Slab&, const Portion&)> visit,
                              const base::Cancellation& cancellation);

  // Of the first shard; those of others may name other levels.
  [[nodiscard]] const store::Manifest& manifest() const { return shards_.front()->manifest(); }
  [[nodiscard]] const volume::BlockLayout& layout() const { return shards_.front()->layout(); }
  [[nodiscard]] const std::vector<std::unique_ptr<store::ShardReader>>& shards() const {
    return shards_;
  }

 private:
  // The ordinals of a shard, by portion and ascending in each.
  struct Ordinals {
    std::vector<std::uint32_t> ordinals;
    std::vector<std::uint32_t> ends;  // by portion
  };
  static Ordinals OrdinalsOf(const store::ShardReader& shard, const PartitionPlan& plan);

  StoredSamples() = default;

  std::vector<std::unique_ptr<store::ShardReader>> shards_;
};

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_STORED_SAMPLES_H_
