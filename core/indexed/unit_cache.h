// Decoded units of sources, bounded in bytes, those that are being decoded included.

#ifndef ISOSCOPE_CORE_INDEXED_UNIT_CACHE_H_
#define ISOSCOPE_CORE_INDEXED_UNIT_CACHE_H_

#include <cstddef>
#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <string>
#include <unordered_map>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/functional/function_ref.h"
#include "absl/hash/hash.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "core/base/cancellation.h"
#include "core/base/memory_budget.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"

namespace isoscope::indexed {

// At most half of the bytes are for units in the making: each needs kMakingFactor times the bytes that
// are decoded for it, for what is stored and for buffers of codecs, and waits until they are free.
// What these leave is for units that are kept, the least recently used of which go first. Thread-safe.
class UnitCache {
 public:
  using Key = std::pair<std::int64_t, std::int64_t>;  // source, unit

  static constexpr std::size_t kMakingFactor = 3;

  explicit UnitCache(std::size_t max_bytes) : max_bytes_(max_bytes), making_(max_bytes / 2) {}

  // Returns a unit of `size` bytes that is kept, or else makes it: `make` fills it in. Threads that
  // want the same unit wait for the one that makes it, and get its error, unless that thread was
  // cancelled: then another one makes it. Waits end with the error of `cancellation`.
  // RESOURCE_EXHAUSTED, with the reason TOO_LARGE: a unit is too large for the bound. Errors of
  // `make`, which takes no unit.
  // decoded_bytes: of what `make` decodes, if that is more than `size`
  absl::StatusOr<std::shared_ptr<const std::string>> Get(
      const Key& key, std::size_t size, std::size_t decoded_bytes,
      const base::Cancellation& cancellation, absl::FunctionRef<absl::Status(char* out)> make)
      ABSL_LOCKS_EXCLUDED(mutex_);

  // A unit that is kept may have other samples by now: it is made again if it is wanted kDoubtfulLife
  // after it was made. Not before, because each of its blocks may say so.
  static constexpr absl::Duration kDoubtfulLife = absl::Seconds(1);
  void Doubt(const Key& key) ABSL_LOCKS_EXCLUDED(mutex_);

  // Whether a unit is kept, or in the making.
  [[nodiscard]] bool Has(const Key& key) const ABSL_LOCKS_EXCLUDED(mutex_);

  // The bytes of kept units for which there is always room.
  [[nodiscard]] std::size_t least_kept_bytes() const { return max_bytes_ - max_bytes_ / 2; }
  [[nodiscard]] std::size_t kept_bytes() const ABSL_LOCKS_EXCLUDED(mutex_);
  // Returns the number of units that were made.
  [[nodiscard]] std::int64_t made_count() const ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  struct Entry {
    Key key;
    std::shared_ptr<const std::string> unit;
    base::MonotonicTime made;
    bool is_doubtful = false;
  };

  // A unit that a thread makes, and others wait for.
  struct Making {
    bool has_ended = false;
    absl::StatusOr<std::shared_ptr<const std::string>> unit = absl::UnknownError("not made");
  };
  // Counts as in the making while it lives; then those who wait learn how it ended.
  class MakingScope;

  std::shared_ptr<const std::string> Find(const Key& key) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::StatusOr<std::shared_ptr<const std::string>> Make(
      const Key& key, std::size_t size, std::size_t decoded_bytes,
      const base::Cancellation& cancellation, absl::FunctionRef<absl::Status(char* out)> make)
      ABSL_LOCKS_EXCLUDED(mutex_);
  // Drops units until there is room for `bytes` more.
  void MakeRoom(std::size_t bytes) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Drop(std::list<Entry>::iterator entry) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Keep(const Key& key, const std::shared_ptr<const std::string>& unit)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const std::size_t max_bytes_;
  base::MemoryBudget making_;
  mutable base::Mutex mutex_;
  base::CondVar made_;
  std::list<Entry> entries_ ABSL_GUARDED_BY(mutex_);  // the last used first
  // Not abseil's, whose maps are broken once an allocation has thrown.
  std::unordered_map<Key, std::list<Entry>::iterator, absl::Hash<Key>> places_
      ABSL_GUARDED_BY(mutex_);
  std::map<Key, std::shared_ptr<Making>> in_the_making_ ABSL_GUARDED_BY(mutex_);
  std::size_t kept_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  std::int64_t made_count_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace isoscope::indexed

#endif  // ISOSCOPE_CORE_INDEXED_UNIT_CACHE_H_
