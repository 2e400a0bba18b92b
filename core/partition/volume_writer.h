// Writes one scalar volume, of the source or a level of it, as shards. Internal to the partitioner,
// whose tests cover it; the steps are at the head of volume_writer.cc.

#ifndef ISOSCOPE_CORE_PARTITION_VOLUME_WRITER_H_
#define ISOSCOPE_CORE_PARTITION_VOLUME_WRITER_H_

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/partition/batch_writer.h"
#include "core/partition/block_batch.h"
#include "core/partition/distribution.h"
#include "core/partition/level_spool.h"
#include "core/partition/partition_plan.h"
#include "core/partition/partitioner.h"
#include "core/partition/portion_reader.h"
#include "core/partition/samples_digest.h"
#include "core/partition/shard_set.h"
#include "core/source/volume_source.h"
#include "core/store/manifest.h"
#include "core/store/part_file.h"
#include "core/store/shard_writer.h"
#include "core/volume/block_layout.h"
#include "core/volume/scalar_span.h"
#include "core/volume/scalar_type.h"

namespace isoscope::partition {

// What was measured of the blocks of a slab.
struct SlabSummary {
  std::vector<store::ShardPiece> shards;  // by index
  std::uint32_t ranges_crc32c = 0;        // of the slab's ranges.bin
  volume::ScalarSpan value_range;
  volume::ScalarSpan finite_range;
  double max_gradient_magnitude = 0;
  DigestSum digest_sum{};
};

// Thread-compatible; works on many threads. References must outlive it.
class VolumeWriter {
 public:
  // plan: of PlanPartition, for the same layout and options
  VolumeWriter(source::VolumeSource* source, const PartitionOptions& options,
               volume::BlockLayout layout, const PartitionPlan& plan,
               const base::Cancellation& cancellation);

  // Writes the shards' folders and the range table into `directory`, which exists, and returns the
  // manifest, whose levels are empty. Called once.
  //
  // next_level: takes the samples of the next level; null: none is wanted
  absl::StatusOr<store::Manifest> Write(const std::string& directory, const std::string& name,
                                        LevelSpool* next_level);

  // Writes the blocks of some layers alone, as pieces of the shards (store/part_file.h), and their
  // ranges. Called once, in place of Write. REQUIRES: the distribution is random; `layers` as
  // PortionsOf, and not empty.
  absl::StatusOr<SlabSummary> WriteSlab(const std::string& directory, const LayerRange& layers,
                                        LevelSpool* next_level);

  // Returns how often all samples are read.
  static int PassCount(const PartitionOptions& options);
  // Returns the bytes of all samples.
  static std::int64_t PassBytes(const source::SourceInfo& info);

 private:
  absl::Status WriteLayers(const std::string& directory, const LayerRange& layers,
                           LevelSpool* next_level);
  absl::Status Pass(PortionReader* reader, const LayerRange& layers,
                    absl::FunctionRef<absl::Status(const Slab&, const Portion&)> visit);
  void Report() const;
  absl::StatusOr<ShardMap> DealOut(PortionReader* reader);
  absl::Status WriteBlocks(const Slab& slab, const Portion& portion);
  absl::StatusOr<store::Manifest> Finish(const std::string& name);

  source::VolumeSource& source_;
  const PartitionOptions& options_;
  const base::Cancellation& cancellation_;
  const volume::BlockLayout layout_;
  const volume::ScalarType type_;
  const PartitionPlan plan_;
  std::int64_t pass_bytes_;

  PartitionProgress progress_;
  std::optional<PlacementQueue> placements_;
  std::optional<BatchCutter> cutter_;
  std::optional<ShardSet> shards_;
  std::optional<BatchWriter> batch_writer_;  // after shards_: it uses them
  std::unique_ptr<store::RangeTableWriter> range_writer_;
  volume::ScalarSpan value_range_;  // of the portions so far
  SamplesDigest samples_digest_;    // of the portions so far
};

// Copies the range table of `directory` into the folders of its shards, and writes the manifest and
// the shard file of each.
absl::Status DescribeShards(const std::string& directory, const store::Manifest& manifest,
                            const base::Cancellation& cancellation);

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_VOLUME_WRITER_H_
