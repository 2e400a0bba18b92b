// The scalar volumes whose samples colour the surfaces of a frame (ColorBy::Quantity::kField), on
// one agent. They are cut as the volume that is drawn, so that a block has the same shard and the
// same ordinal in all of them.

#ifndef ISOSCOPE_PARTITION_AGENT_SUPPLY_COLOR_VOLUMES_H_
#define ISOSCOPE_PARTITION_AGENT_SUPPLY_COLOR_VOLUMES_H_

#include <bitset>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/frame/frame_spec.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_samples.h"
#include "partition-agent/memory/agent_resources.h"
#include "partition-agent/memory/queued_reads.h"
#include "partition-agent/shard/shard.h"
#include "partition-agent/supply/block_reads.h"

namespace isoscope::agent {

// Immutable; thread-safe.
class ColorVolumes {
 public:
  // No surface is coloured so.
  ColorVolumes() = default;

  // by_surface: for each surface, the shards of its volume, with the indices of `shards` in their
  //             order; empty: it shows no other field
  //
  // FAILED_PRECONDITION if a volume is cut in another way; the message has both values.
  static absl::StatusOr<ColorVolumes> Make(const Shards& shards,
                                           const std::vector<Shards>& by_surface);

  [[nodiscard]] bool empty() const { return shards_.empty(); }
  // Volumes are counted once, however many surfaces show them. Those of a frame are at most as many
  // as its surfaces.
  [[nodiscard]] std::size_t volume_count() const { return volume_count_; }
  // The volume of a surface. Not set: it shows no other field.
  [[nodiscard]] std::optional<std::size_t> VolumeOf(std::size_t surface_index) const {
    return surface_index < volume_of_.size() ? volume_of_[surface_index] : std::nullopt;
  }
  // The shards of all volumes; that of a volume is at IndexOf.
  [[nodiscard]] const Shards& shards() const { return shards_; }
  [[nodiscard]] std::size_t IndexOf(std::size_t volume, std::size_t shard_index) const {
    return volume * (shards_.size() / volume_count_) + shard_index;
  }
  // The shard that colours a surface; null if it shows no other field.
  [[nodiscard]] const Shard* ShardOf(std::size_t shard_index, std::size_t surface_index) const {
    const std::optional<std::size_t> volume = VolumeOf(surface_index);
    return volume.has_value() ? shards_[IndexOf(*volume, shard_index)].get() : nullptr;
  }

  // FAILED_PRECONDITION if a volume has another block at the ordinal. REQUIRES: it is one of the
  // shard of the drawn volume.
  [[nodiscard]] absl::Status CheckBlock(std::size_t shard_index, std::uint32_t ordinal,
                                        volume::BlockId block_id) const;

 private:
  Shards shards_;
  std::size_t volume_count_ = 0;
  std::vector<std::optional<std::size_t>> volume_of_;  // by surface
};

// A set of the volumes of ColorVolumes.
using VolumeSet = std::bitset<frame::kMaxSurfaces>;

// A block to read, and the volumes whose samples of it are wanted too.
struct ColoredBlock {
  BlockToRead block;
  VolumeSet volumes = {};
};

// Visits the blocks as BlockReads::ForEach, each with its samples in the volumes that are wanted:
// from the cache, or read first and offered to it. Keeps to resources.max_read_bytes, those samples
// included; one disk run or block may exceed half of it. Returns the bytes read. Errors as
// BlockReads::ForEach.
//
// shards: those of the drawn volume
// blocks: ascending, each once
// visit:  fields: by volume; bytes are null where they were not wanted
using VisitColored =
    absl::FunctionRef<absl::Status(std::size_t block, const volume::BlockSamples& samples,
                                   std::span<const volume::BlockSamples> fields)>;
absl::StatusOr<std::int64_t> VisitColoredBlocks(const Shards& shards, const ColorVolumes& colors,
                                                const std::vector<ColoredBlock>& blocks,
                                                const AgentResources& resources,
                                                const base::Cancellation& cancellation,
                                                VisitColored visit, const Pauses& pauses = {});

// Returns the samples of a block in a volume; of those that the caller keeps in `bytes`.
volume::BlockSamples SamplesOf(const Shard& shard, std::uint32_t ordinal, const std::string& bytes);

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_SUPPLY_COLOR_VOLUMES_H_
