// Extracted meshes, kept between frames, bounded in bytes.
//
// Meshes lie one after the other in segments of memory. The cache evicts whole segments, the least
// recently used first. So the bound counts the real memory, no mesh needs an allocation, and the
// lookup of a mesh in its table needs neither a hash nor a list. While a slider moves through
// isovalues, the cache recycles segments: touching fresh memory costs more than extracting a mesh
// again.

#ifndef ISOSCOPE_PARTITION_AGENT_CACHE_MESH_CACHE_H_
#define ISOSCOPE_PARTITION_AGENT_CACHE_MESH_CACHE_H_

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <unordered_map>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/hash/hash.h"

#include "core/base/memory_pool.h"
#include "core/base/mutex.h"
#include "core/mesh/block_mesh.h"
#include "core/mesh/compact_mesh.h"
#include "core/volume/inside_rule.h"

namespace isoscope::agent {

// A range of memory that fills up with meshes. Written by one thread at a time.
struct MeshSegment {
  std::shared_ptr<char[]> memory;
  std::size_t size_bytes = 0;
  std::size_t used_bytes = 0;
  std::atomic<std::uint64_t> round{0};  // the last round that used it
  void NoteUse(std::uint64_t in_round) {
    std::uint64_t last = round.load(std::memory_order_relaxed);
    while (last < in_round &&
           !round.compare_exchange_weak(last, in_round, std::memory_order_relaxed)) {
    }
  }
  std::atomic<bool> is_kept{true};  // false: it lives only as long as one of its meshes is held
};

// The source of the values that a mesh's vertices have.
struct MeshValues {
  enum class Of : std::uint8_t { kNothing, kGradientMagnitude, kField };

  Of of = Of::kNothing;
  std::uint32_t field_shard_number = 0;  // Shard::number of the field's samples; of kField alone

  friend bool operator==(const MeshValues&, const MeshValues&) = default;
  // For absl::Hash.
  template <typename H>
  friend H AbslHashValue(H hash, const MeshValues& values) {
    return H::combine(std::move(hash), values.of, values.field_shard_number);
  }
};

// The meshes of one shard and one surface with one kind of values, by active index in the shard's
// list of active blocks. Thread-safe.
class MeshTable {
 public:
  explicit MeshTable(std::size_t block_count) : slots_(block_count) {}
  [[nodiscard]] std::size_t size_bytes() const {
    return sizeof(MeshTable) + slots_.capacity() * sizeof(Slot);
  }

  // Returns null if the mesh is not kept. REQUIRES: active_index < block_count.
  std::shared_ptr<const mesh::CompactMesh> Find(std::size_t active_index, std::uint64_t round);
  // Returns true if the mesh is kept. Does not count as use. REQUIRES: as Find.
  [[nodiscard]] bool Has(std::size_t active_index);

 private:
  friend class MeshCache;
  struct Slot {
    const mesh::CompactMesh* mesh = nullptr;
    std::weak_ptr<MeshSegment> segment;
  };
  static constexpr std::size_t kLockCount = 64;

  base::Mutex& LockOf(std::size_t active_index) { return locks_[active_index / 64 % kLockCount]; }
  void Set(std::size_t active_index, Slot slot);

  std::array<base::Mutex, kLockCount> locks_;  // each guards every 64th group of 64 slots
  std::vector<Slot> slots_;                    // by active index
};

// Thread-safe.
class MeshCache {
 public:
  explicit MeshCache(std::shared_ptr<base::MemoryPool> pool) : pool_(std::move(pool)) {}

  // Sets the bound, which holds from the next segment on. 0: nothing is kept beyond the frame.
  void SetMaxBytes(std::size_t max_bytes) {
    const base::MutexLock lock(&mutex_);
    max_bytes_ = max_bytes;
  }

  // Begins a frame and returns its round. Agents of one process may call it for the same frame.
  std::uint64_t BeginRound(std::int64_t frame_number);

  // Returns the table of a shard (by Shard::number) and a surface, and makes it if there is none.
  // Meshes with other values have tables of their own. Evicts the least recently used tables if
  // all take more than 1 / kTableShare of the bytes.
  std::shared_ptr<MeshTable> TableOf(std::uint32_t shard_number, const volume::InsideRule& rule,
                                     std::size_t block_count, const MeshValues& values = {});

  // Copies meshes into segments, for one thread at a time. A stored mesh lives as long as it is
  // held, even if the cache does not keep it.
  class Writer {
   public:
    Writer(MeshCache* cache, std::uint64_t round) : cache_(cache), round_(round) {}
    ~Writer();
    Writer(Writer&& other) noexcept
        : cache_(other.cache_), round_(other.round_), segment_(std::move(other.segment_)) {}
    Writer& operator=(Writer&&) = delete;

    std::shared_ptr<const mesh::CompactMesh> Store(const mesh::BlockMeshView& mesh,
                                                   MeshTable* table, std::size_t active_index);

   private:
    MeshCache* const cache_;
    const std::uint64_t round_;
    std::shared_ptr<MeshSegment> segment_;
  };

  // Returns true if this round and the last one each asked for isovalues that the round before it
  // did not ask for. At least one of these must be new to all recent rounds. So users who take
  // turns, each at one isovalue, do not count as a slider.
  [[nodiscard]] bool is_slider_moving() const {
    return is_slider_moving_.load(std::memory_order_relaxed);
  }
  // Returns the number of segments that found no room.
  [[nodiscard]] std::uint64_t unkept_count() const {
    return unkept_count_.load(std::memory_order_relaxed);
  }
  [[nodiscard]] std::size_t size_bytes() const {
    const base::MutexLock lock(&mutex_);
    return segment_bytes_ + table_bytes_;
  }
  [[nodiscard]] std::size_t max_bytes() const {
    const base::MutexLock lock(&mutex_);
    return max_bytes_;
  }

 private:
  struct KeyedTable {
    std::uint32_t shard_number = 0;
    volume::InsideRule rule;
    MeshValues values;
    std::shared_ptr<MeshTable> table;

    [[nodiscard]] std::size_t size_bytes() const {
      return table->size_bytes() + rule.labels.size() * sizeof(double);
    }
  };
  // Finds a table. Kept ones point to the rule of their KeyedTable.
  struct TableKey {
    std::uint32_t shard_number = 0;
    const volume::InsideRule* rule = nullptr;
    MeshValues values;

    friend bool operator==(const TableKey& a, const TableKey& b) {
      return a.shard_number == b.shard_number && *a.rule == *b.rule && a.values == b.values;
    }
    template <typename H>
    friend H AbslHashValue(H hash, const TableKey& key) {
      return H::combine(std::move(hash), key.shard_number, *key.rule, key.values);
    }
  };
  static constexpr std::size_t kTableShare = 8;
  // The most users who take turns. A larger number makes a slider that reverses take more fresh
  // memory.
  static constexpr std::uint64_t kRecentRounds = 4;
  // Changes of a round's surfaces against the rounds before.
  struct Motion {
    bool has_moved = false;  // one was not asked for in the last round
    bool has_new = false;    // one was not asked for in the last kRecentRounds
  };
  // Returns true if a slider moves and this round is at a new isovalue. A round at a recent
  // isovalue may be another user's.
  bool MayRecycle() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return last_motion_.has_moved && motion_.has_new;
  }
  // Moves the segment with the lowest round to `evicted`. False if this round or the last one
  // has used all of them.
  bool EvictOldest(std::uint64_t round, std::vector<std::shared_ptr<MeshSegment>>* evicted)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  // Drops a segment that got no memory.
  void Withdraw(const std::shared_ptr<MeshSegment>& segment);
  // Returns a segment with at least `size_bytes` of room.
  std::shared_ptr<MeshSegment> TakeSegment(std::size_t size_bytes, std::uint64_t round);
  // Lets another writer fill the rest of the segment. Allocates nothing, for destructors.
  void GiveBack(std::shared_ptr<MeshSegment> segment);

  const std::shared_ptr<base::MemoryPool> pool_;
  mutable base::Mutex mutex_;
  std::size_t max_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  std::size_t segment_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  std::size_t table_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  std::vector<std::shared_ptr<MeshSegment>> segments_ ABSL_GUARDED_BY(mutex_);  // all kept ones
  // Those with room. Its capacity is enough for all kept ones.
  std::vector<std::shared_ptr<MeshSegment>> open_ ABSL_GUARDED_BY(mutex_);
  std::list<KeyedTable> tables_ ABSL_GUARDED_BY(mutex_);  // most recently used first
  // absl's maps break where memory runs out while they grow.
  std::unordered_map<TableKey, std::list<KeyedTable>::iterator, absl::Hash<TableKey>> table_index_
      ABSL_GUARDED_BY(mutex_);
  std::int64_t frame_number_ ABSL_GUARDED_BY(mutex_) = -1;
  std::uint64_t round_ ABSL_GUARDED_BY(mutex_) = 2;
  // The rules of the last kRecentRounds, with the last round that asked for each.
  std::unordered_map<volume::InsideRule, std::uint64_t, absl::Hash<volume::InsideRule>> asked_
      ABSL_GUARDED_BY(mutex_);
  Motion motion_ ABSL_GUARDED_BY(mutex_);       // of this round
  Motion last_motion_ ABSL_GUARDED_BY(mutex_);  // of the round before
  std::atomic<bool> is_slider_moving_{false};
  std::atomic<std::uint64_t> unkept_count_{0};
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_CACHE_MESH_CACHE_H_
