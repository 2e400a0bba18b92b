// The way to a mesh:
//
//   MeshCache::tables_   MeshTables, the last used first; table_index_ finds one by its shard, its
//                        surface and what vertices have values of
//   MeshTable::slots_    active index to the mesh and a weak pointer to its segment
//   MeshSegment          memory that fills up with meshes, from its beginning on
//
// * Store copies a mesh into the writer's segment, and enters it into the table. A writer without
//   room takes another segment: a chunk of the pool, or memory of its own for a mesh that is larger.
// * Find locks the weak pointer. If the segment is gone, the mesh is not kept. Otherwise the
//   segment is marked as used in this round, and the returned pointer keeps all of it alive.
// * Only TakeSegment evicts. It drops the segment with the lowest round until there is room, but
//   never one that this round or the last one has used. If there is still no room, the new segment
//   is not kept: it serves its frame, and its meshes do not enter the table.
// * A slider moves if two successive rounds asked for other isovalues than the rounds before them.
//   Then a segment is also evicted if the pool has no touched chunk left for a new one. A round at
//   a recent isovalue evicts none: two users at two isovalues take turns, and each needs the meshes
//   of that isovalue again.
//
// A round is a frame. Agents of one process that draw the same frame share its round. Tables may
// take an eighth of the bytes, segments the rest.
//
// Threads: each mutex of a table guards the slots of some active indices. One writer at a time
// fills a segment. The mutex of the cache guards the lists.

#include "partition-agent/cache/mesh_cache.h"

#include <algorithm>

#include "absl/cleanup/cleanup.h"

#include "core/base/check.h"

namespace isoscope::agent {

std::shared_ptr<const mesh::CompactMesh> MeshTable::Find(std::size_t active_index,
                                                         std::uint64_t round) {
  ISOSCOPE_DCHECK(active_index < slots_.size());
  base::MutexLock lock(&LockOf(active_index));
  const Slot& slot = slots_[active_index];
  const std::shared_ptr<MeshSegment> segment = slot.segment.lock();
  if (segment == nullptr) {
    return nullptr;
  }
  segment->NoteUse(round);
  return {segment, slot.mesh};
}

bool MeshTable::Has(std::size_t active_index) {
  ISOSCOPE_DCHECK(active_index < slots_.size());
  base::MutexLock lock(&LockOf(active_index));
  return !slots_[active_index].segment.expired();
}

void MeshTable::Set(std::size_t active_index, Slot slot) {
  base::MutexLock lock(&LockOf(active_index));
  slots_[active_index] = std::move(slot);
}

std::uint64_t MeshCache::BeginRound(std::int64_t frame_number) {
  base::MutexLock lock(&mutex_);
  if (frame_number != frame_number_) {
    frame_number_ = frame_number;
    ++round_;
    last_motion_ = std::exchange(motion_, {});
    is_slider_moving_.store(false, std::memory_order_relaxed);
    std::erase_if(asked_, [this](const auto& asked) ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
      return asked.second + kRecentRounds < round_;
    });
  }
  return round_;
}

std::shared_ptr<MeshTable> MeshCache::TableOf(std::uint32_t shard_number,
                                              const volume::InsideRule& rule,
                                              std::size_t block_count, const MeshValues& values) {
  base::MutexLock lock(&mutex_);
  const auto [asked, is_new] = asked_.try_emplace(rule, round_);
  if (is_new) {
    motion_ = {.has_moved = true, .has_new = true};
  } else {
    motion_.has_moved = motion_.has_moved || asked->second + 1 < round_;
    asked->second = round_;
  }
  is_slider_moving_.store(
      motion_.has_moved && last_motion_.has_moved && (motion_.has_new || last_motion_.has_new),
      std::memory_order_relaxed);
  const auto found = table_index_.find({shard_number, &rule, values});
  if (found != table_index_.end()) {
    tables_.splice(tables_.begin(), tables_, found->second);
    return found->second->table;
  }
  auto table = std::make_shared<MeshTable>(block_count);
  std::list<KeyedTable> added;  // so that memory that runs out leaves list and index as they are
  added.push_front({shard_number, rule, values, table});
  table_index_.emplace(TableKey{shard_number, &added.front().rule, values}, added.begin());
  tables_.splice(tables_.begin(), added);
  table_bytes_ += tables_.front().size_bytes();
  while (table_bytes_ > max_bytes_ / kTableShare) {  // the new table goes last
    const KeyedTable& oldest = tables_.back();
    table_bytes_ -= oldest.size_bytes();
    table_index_.erase({oldest.shard_number, &oldest.rule, oldest.values});
    tables_.pop_back();
  }
  return table;
}

MeshCache::Writer::~Writer() {
  if (segment_ != nullptr) {
    cache_->GiveBack(std::move(segment_));
  }
}

std::shared_ptr<const mesh::CompactMesh> MeshCache::Writer::Store(const mesh::BlockMeshView& mesh,
                                                                  MeshTable* table,
                                                                  std::size_t active_index) {
  const std::size_t size = mesh::CompactSizeBytes(mesh);
  if (segment_ == nullptr || segment_->size_bytes - segment_->used_bytes < size) {
    segment_ = cache_->TakeSegment(size, round_);
  }
  const mesh::CompactMesh* const compact =
      mesh::CompactInto(mesh, segment_->memory.get() + segment_->used_bytes);
  segment_->used_bytes += size;
  if (segment_->is_kept.load(std::memory_order_relaxed)) {
    table->Set(active_index, {compact, segment_});
  }
  return {segment_, compact};
}

std::shared_ptr<MeshSegment> MeshCache::TakeSegment(std::size_t size_bytes, std::uint64_t round) {
  std::vector<std::shared_ptr<MeshSegment>> evicted;
  auto segment = std::make_shared<MeshSegment>();
  segment->size_bytes = std::max(size_bytes, pool_->chunk_bytes());
  segment->round.store(round, std::memory_order_relaxed);
  {
    base::MutexLock lock(&mutex_);
    for (auto open = open_.begin(); open != open_.end(); ++open) {
      if ((*open)->size_bytes - (*open)->used_bytes >= size_bytes) {
        std::shared_ptr<MeshSegment> found = std::move(*open);
        open_.erase(open);
        found->NoteUse(round);
        return found;
      }
    }
    // A segment that this round or the last one has used stays. Successive frames use mostly the
    // same blocks, so the next frame needs its meshes.
    const std::size_t max_segment_bytes = max_bytes_ - max_bytes_ / kTableShare;
    while (segment->size_bytes <= max_segment_bytes &&
           segment_bytes_ + segment->size_bytes > max_segment_bytes &&
           EvictOldest(round, &evicted)) {
    }
    if (evicted.empty() && MayRecycle() && pool_->touched_free_bytes() == 0) {
      EvictOldest(round, &evicted);
    }
    if (segment_bytes_ + segment->size_bytes <= max_segment_bytes) {
      if (open_.capacity() <= segments_.size()) {
        open_.reserve(2 * segments_.size() + 1);
      }
      segments_.push_back(segment);
      segment_bytes_ += segment->size_bytes;
    } else {
      segment->is_kept.store(false, std::memory_order_relaxed);
      unkept_count_.fetch_add(1, std::memory_order_relaxed);
    }
  }
  evicted.clear();  // frees their chunks for the new segment
  absl::Cleanup withdraw = [this, &segment] { Withdraw(segment); };
  segment->memory = segment->size_bytes <= pool_->chunk_bytes()
                        ? pool_->Take()
                        : std::make_shared_for_overwrite<char[]>(segment->size_bytes);
  std::move(withdraw).Cancel();
  return segment;
}

void MeshCache::Withdraw(const std::shared_ptr<MeshSegment>& segment) {
  const base::MutexLock lock(&mutex_);
  if (std::erase(segments_, segment) > 0) {
    segment_bytes_ -= segment->size_bytes;
  }
}

bool MeshCache::EvictOldest(std::uint64_t round,
                            std::vector<std::shared_ptr<MeshSegment>>* evicted) {
  const auto oldest =
      std::min_element(segments_.begin(), segments_.end(), [](const auto& a, const auto& b) {
        return a->round.load(std::memory_order_relaxed) < b->round.load(std::memory_order_relaxed);
      });
  if (oldest == segments_.end() || (*oldest)->round.load(std::memory_order_relaxed) + 1 >= round) {
    return false;
  }
  evicted->push_back(*oldest);
  (*oldest)->is_kept.store(false, std::memory_order_relaxed);
  std::erase(open_, *oldest);
  segment_bytes_ -= (*oldest)->size_bytes;
  *oldest = std::move(segments_.back());
  segments_.pop_back();
  return true;
}

void MeshCache::GiveBack(std::shared_ptr<MeshSegment> segment) {
  base::MutexLock lock(&mutex_);
  if (segment->is_kept.load(std::memory_order_relaxed)) {
    open_.push_back(std::move(segment));
  }
}

}  // namespace isoscope::agent
