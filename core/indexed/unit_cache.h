// Decoded units of sources, bounded in bytes, those that are being decoded included.

#ifndef ISOSCOPE_CORE_INDEXED_UNIT_CACHE_H_
#define ISOSCOPE_CORE_INDEXED_UNIT_CACHE_H_

#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <set>
#include <string>
#include <unordered_map>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/functional/function_ref.h"
#include "absl/hash/hash.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/memory_budget.h"
#include "core/base/mutex.h"

namespace isoscope::indexed {

// Half of the bytes are for units that are kept, the least recently used of which go first. The other
// half is for those in the making: each needs kMakingFactor times the bytes that are decoded for it,
// for what is stored and for buffers of codecs, and waits until they are free. Thread-safe.
class UnitCache {
 public:
  using Key = std::pair<std::int64_t, std::int64_t>;  // source, unit

  static constexpr std::size_t kMakingFactor = 3;

  explicit UnitCache(std::size_t max_bytes)
      : max_kept_bytes_(max_bytes / 2), making_(max_bytes / 2) {}

  // Returns a unit of `size` bytes that is kept, or else makes it: `make` fills it in. Threads that
  // want the same unit wait for the one that makes it; after its error each tries by itself.
  // RESOURCE_EXHAUSTED: a unit is too large for the bound. Errors of `make`, which takes no unit.
  // decoded_bytes: of what `make` decodes, if that is more than `size`
  absl::StatusOr<std::shared_ptr<const std::string>> Get(
      const Key& key, std::size_t size, std::size_t decoded_bytes,
      absl::FunctionRef<absl::Status(char* out)> make) ABSL_LOCKS_EXCLUDED(mutex_);

  [[nodiscard]] std::size_t kept_bytes() const ABSL_LOCKS_EXCLUDED(mutex_);
  // Returns the number of units that were made.
  [[nodiscard]] std::int64_t made_count() const ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  struct Entry {
    Key key;
    std::shared_ptr<const std::string> unit;
  };

  std::shared_ptr<const std::string> Find(const Key& key) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Keep(const Key& key, const std::shared_ptr<const std::string>& unit)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const std::size_t max_kept_bytes_;
  base::MemoryBudget making_;
  mutable base::Mutex mutex_;
  base::CondVar made_;
  std::list<Entry> entries_ ABSL_GUARDED_BY(mutex_);  // the last used first
  // Not abseil's, whose maps are broken once an allocation has thrown.
  std::unordered_map<Key, std::list<Entry>::iterator, absl::Hash<Key>> places_
      ABSL_GUARDED_BY(mutex_);
  std::set<Key> in_the_making_ ABSL_GUARDED_BY(mutex_);
  std::size_t kept_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  std::int64_t made_count_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace isoscope::indexed

#endif  // ISOSCOPE_CORE_INDEXED_UNIT_CACHE_H_
