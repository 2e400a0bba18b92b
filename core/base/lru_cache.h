// A cache bounded in bytes, which evicts the values that were least recently used.

#ifndef ISOSCOPE_CORE_BASE_LRU_CACHE_H_
#define ISOSCOPE_CORE_BASE_LRU_CACHE_H_

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <list>
#include <memory>
#include <unordered_map>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/hash/hash.h"

#include "core/base/mutex.h"

namespace isoscope::base {

// Thread-safe. Values are shared: an evicted value lives on as long as somebody holds it.
//
// Work comes in rounds (frames) that look at much the same keys in the same order. If those do not
// fit, plain LRU would evict each value just before its next use. So a new value never evicts an
// entry that this round or the last one has used. The cache keeps a part of the working set, and
// finds that part each round.
//
// The cache has kPartCount parts of equal size, with a lock each, so that threads seldom wait for
// each other. It keeps no value larger than a part.
template <typename Key, typename Value, std::size_t kPartCount = 16>
class LruCache {
 public:
  // Holds at most `max_bytes`, as the callers of Insert count them.
  explicit LruCache(std::size_t max_bytes) { SetMaxBytes(max_bytes); }
  LruCache(const LruCache&) = delete;
  LruCache& operator=(const LruCache&) = delete;

  // Takes effect with the next insertions.
  void SetMaxBytes(std::size_t max_bytes) {
    max_part_bytes_.store(max_bytes / kPartCount, std::memory_order_relaxed);
  }

  // Begins a round. Rounds are numbered upward from 2 and may overlap.
  void SetRound(std::uint64_t round) { round_.store(round, std::memory_order_relaxed); }

  // Returns the value of `key`; null if the cache does not have it.
  std::shared_ptr<const Value> Find(const Key& key) {
    Part& part = PartOf(key);
    MutexLock lock(&part.mutex);
    const auto found = part.places.find(key);
    if (found == part.places.end()) {
      return nullptr;
    }
    part.entries.splice(part.entries.begin(), part.entries, found->second);
    found->second->round = round_.load(std::memory_order_relaxed);
    return found->second->value;
  }

  // Keeps `value` unless there is no room for it. A key that has a value keeps that value. If it
  // throws std::bad_alloc, it has changed nothing, except that it may have evicted values.
  void Insert(const Key& key, std::shared_ptr<const Value> value, std::size_t size_bytes) {
    const std::size_t size = size_bytes + kEntryBytes;
    const std::size_t max_bytes = max_part_bytes_.load(std::memory_order_relaxed);
    const std::uint64_t round = round_.load(std::memory_order_relaxed);
    std::list<Entry> forgotten;  // freed after the lock
    std::list<Entry> added;
    added.push_front({key, std::move(value), size, round});
    Part& part = PartOf(key);
    MutexLock lock(&part.mutex);
    if (size > max_bytes || part.places.contains(key)) {
      return;
    }
    while (part.size_bytes + size > max_bytes) {
      const auto last = std::prev(part.entries.end());
      if (last->round + 1 >= round) {
        return;
      }
      part.size_bytes -= last->size_bytes;
      part.places.erase(last->key);
      forgotten.splice(forgotten.begin(), part.entries, last);
    }
    part.places.emplace(key, added.begin());
    part.entries.splice(part.entries.begin(), added);
    part.size_bytes += size;
  }

  [[nodiscard]] std::size_t size_bytes() const {
    std::size_t sum = 0;
    for (const Part& part : parts_) {
      MutexLock lock(&part.mutex);
      sum += part.size_bytes;
    }
    return sum;
  }

 private:
  struct Entry {
    Key key;
    std::shared_ptr<const Value> value;
    std::size_t size_bytes = 0;
    std::uint64_t round = 0;
  };
  // The bytes of an entry beside its value: list node, map node, control block.
  static constexpr std::size_t kEntryBytes = sizeof(Entry) + sizeof(Key) + 64;

  struct alignas(64) Part {
    mutable Mutex mutex;
    std::list<Entry> entries ABSL_GUARDED_BY(mutex);  // the last used first
    // Not abseil's, whose maps are broken once an allocation has thrown.
    std::unordered_map<Key, typename std::list<Entry>::iterator, absl::Hash<Key>> places
        ABSL_GUARDED_BY(mutex);
    std::size_t size_bytes ABSL_GUARDED_BY(mutex) = 0;
  };

  Part& PartOf(const Key& key) {
    // The map uses the low bits.
    return parts_[(absl::Hash<Key>{}(key) >> 32) % kPartCount];
  }

  std::atomic<std::size_t> max_part_bytes_{0};
  std::atomic<std::uint64_t> round_{2};
  std::array<Part, kPartCount> parts_;
};

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_LRU_CACHE_H_
