// Meshes, samples and active blocks that an agent keeps between frames, bounded in bytes. A frame
// from a new view extracts no kept mesh again. A frame at an earlier isovalue reads no kept block
// again.

#ifndef ISOSCOPE_PARTITION_AGENT_CACHE_BLOCK_CACHE_H_
#define ISOSCOPE_PARTITION_AGENT_CACHE_BLOCK_CACHE_H_

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "absl/hash/hash.h"
#include "absl/strings/string_view.h"

#include "core/base/lru_cache.h"
#include "core/base/memory_pool.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_samples.h"
#include "core/volume/inside_rule.h"
#include "partition-agent/cache/mesh_cache.h"
#include "partition-agent/shard/shard.h"

namespace isoscope::agent {

// An active block of a shard.
struct ActiveBlock {
  volume::BlockId block_id = 0;
  std::uint32_t ordinal = 0;
};

// Thread-safe. Shards are told apart by Shard::number.
class BlockCache {  // NOLINT(clang-analyzer-optin.performance.Padding): one an agent
 public:
  // At most `max_bytes` in all: most of it for meshes, which lie in memory of `pool`.
  explicit BlockCache(std::size_t max_bytes,
                      std::shared_ptr<base::MemoryPool> pool = base::MemoryPool::Make())
      : pool_(std::move(pool)), meshes_(pool_), samples_(0), actives_(0), seen_(kSeenWords) {
    SetMaxBytes(max_bytes);
  }

  // Takes effect with the next insertions.
  void SetMaxBytes(std::size_t max_bytes) {
    meshes_.SetMaxBytes(max_bytes / 16 * 11);
    samples_.SetMaxBytes(max_bytes / 4);
    actives_.SetMaxBytes(max_bytes / 16);
  }

  // Takes memory for meshes from the kernel, so that the first frame need not. Blocks.
  void Populate(std::size_t bytes) { pool_->Populate(bytes); }
  // Takes a large page if less than `ahead_bytes` of unused memory is left, within the bound.
  // Returns true if it has taken one; false if the kernel has no memory. Blocks for some
  // milliseconds.
  bool PopulateAhead(std::size_t ahead_bytes) {
    const std::size_t waiting = pool_->touched_free_bytes();
    if (waiting >= ahead_bytes || meshes_.size_bytes() + waiting >= meshes_.max_bytes()) {
      return false;
    }
    try {
      pool_->Populate(1);
    } catch (const std::bad_alloc&) {  // frames report it
      return false;
    }
    return true;
  }

  // Begins a frame; `frame_number` identifies it. Returns its round.
  std::uint64_t BeginRound(std::int64_t frame_number) {
    const std::uint64_t round = meshes_.BeginRound(frame_number);
    slider_bytes_.store(0, std::memory_order_relaxed);
    samples_.SetRound(round);
    actives_.SetRound(round);
    return round;
  }

  [[nodiscard]] MeshCache* meshes() { return &meshes_; }

  // Returns the stored samples of a block; null if they are not kept.
  std::shared_ptr<const std::string> FindSamples(const Shard& shard, std::uint32_t ordinal) {
    return samples_.Find({shard.number, ordinal});
  }
  // Keeps a copy of the samples if the block was read before: most blocks are read only once. While
  // a slider moves, only a few blocks of a frame are kept: touching fresh memory costs more than
  // reading them again.
  void OfferSamples(const Shard& shard, std::uint32_t ordinal, absl::string_view samples) {
    const BlockKey key{shard.number, ordinal};
    const std::size_t bit = absl::Hash<BlockKey>{}(key) % (64 * kSeenWords);
    const std::uint64_t mask = std::uint64_t{1} << (bit % 64);
    const bool was_read = (seen_[bit / 64].fetch_or(mask, std::memory_order_relaxed) & mask) != 0;
    if (was_read &&
        (!meshes_.is_slider_moving() ||
         slider_bytes_.fetch_add(samples.size(), std::memory_order_relaxed) < kMaxSliderBytes)) {
      samples_.Insert(key, std::make_shared<const std::string>(samples), samples.size());
    }
  }

  void OfferSamples(const Shard& shard, std::uint32_t ordinal,
                    const volume::BlockSamples& samples) {
    OfferSamples(shard, ordinal,
                 {samples.bytes,
                  volume::StoredSizeBytes(shard.reader->layout(), samples.block_id, samples.type)});
  }

  // Returns the active blocks of a shard, ascending by block id; null if they are not kept.
  std::shared_ptr<const std::vector<ActiveBlock>> FindActive(const Shard& shard,
                                                             const volume::InsideRule& rule) {
    return actives_.Find({shard.number, rule});
  }
  void InsertActive(const Shard& shard, const volume::InsideRule& rule,
                    std::shared_ptr<const std::vector<ActiveBlock>> active) {
    // The key is kept twice, in the list and in the map.
    const std::size_t size =
        active->capacity() * sizeof(ActiveBlock) + 2 * rule.labels.size() * sizeof(double);
    actives_.Insert({shard.number, rule}, std::move(active), size);
  }

  [[nodiscard]] std::size_t mesh_bytes() const { return meshes_.size_bytes(); }
  [[nodiscard]] std::size_t sample_bytes() const { return samples_.size_bytes(); }
  [[nodiscard]] std::size_t active_bytes() const { return actives_.size_bytes(); }
  [[nodiscard]] std::size_t size_bytes() const {
    return meshes_.size_bytes() + samples_.size_bytes() + actives_.size_bytes();
  }

 private:
  using BlockKey = std::pair<std::uint32_t, std::uint32_t>;  // shard, ordinal
  using ActiveKey = std::pair<std::uint32_t, volume::InsideRule>;

  const std::shared_ptr<base::MemoryPool> pool_;
  MeshCache meshes_;
  base::LruCache<BlockKey, std::string> samples_;
  base::LruCache<ActiveKey, std::vector<ActiveBlock>, 1> actives_;
  // The most bytes of samples that a frame keeps while a slider moves.
  static constexpr std::size_t kMaxSliderBytes = std::size_t{3} << 19;
  std::atomic<std::size_t> slider_bytes_{0};
  // A bit for each hash of a block that was read. If two blocks share a bit, one of them is kept
  // early.
  static constexpr std::size_t kSeenWords = std::size_t{1} << 16;
  std::vector<std::atomic<std::uint64_t>> seen_;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_CACHE_BLOCK_CACHE_H_
