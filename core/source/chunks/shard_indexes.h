// Indexes of shards that readers keep, bounded in bytes for all arrays together.

#ifndef ISOSCOPE_CORE_SOURCE_CHUNKS_SHARD_INDEXES_H_
#define ISOSCOPE_CORE_SOURCE_CHUNKS_SHARD_INDEXES_H_

#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"

#include "core/base/mutex.h"
#include "core/base/units.h"
#include "core/source/chunks/shard_layout.h"

namespace isoscope::source {

// The least recently used ones go first. The last used one stays, however large it is: a reader of its
// chunks would ask for it again and again. Thread-safe.
class ShardIndexes {
 public:
  // Null: there is no such shard.
  using Index = std::shared_ptr<const std::vector<ShardEntry>>;

  static constexpr std::int64_t kDefaultMaxBytes = 64 * base::kMiB;

  explicit ShardIndexes(std::int64_t max_bytes) : max_bytes_(max_bytes) {}
  ShardIndexes(const ShardIndexes&) = delete;
  ShardIndexes& operator=(const ShardIndexes&) = delete;

  // Those of the process, with kDefaultMaxBytes until somebody sets another bound.
  static ShardIndexes& OfProcess();

  void SetMaxBytes(std::int64_t max_bytes) ABSL_LOCKS_EXCLUDED(mutex_);
  // Returns a number for an array, which no other one has.
  std::int64_t NumberArray() ABSL_LOCKS_EXCLUDED(mutex_);
  // Drops what an array has.
  void Forget(std::int64_t array) ABSL_LOCKS_EXCLUDED(mutex_);

  // By the key of the shard. Nothing if it is not kept.
  std::optional<Index> Find(std::int64_t array, const std::string& key) ABSL_LOCKS_EXCLUDED(mutex_);
  void Keep(std::int64_t array, const std::string& key, Index index) ABSL_LOCKS_EXCLUDED(mutex_);

  [[nodiscard]] std::int64_t kept_bytes() const ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  using Key = std::pair<std::int64_t, std::string>;  // array, shard
  struct Entry {
    Key key;
    Index index;
    std::int64_t bytes = 0;
  };
  using Place = std::list<Entry>::iterator;

  void DropSome() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Drop(std::map<Key, Place>::iterator kept) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  mutable base::Mutex mutex_;
  std::int64_t max_bytes_ ABSL_GUARDED_BY(mutex_);
  std::int64_t next_array_ ABSL_GUARDED_BY(mutex_) = 0;
  std::list<Entry> entries_ ABSL_GUARDED_BY(mutex_);  // the last used first
  std::map<Key, Place> places_ ABSL_GUARDED_BY(mutex_);
  std::int64_t kept_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_CHUNKS_SHARD_INDEXES_H_
