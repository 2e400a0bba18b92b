// A unit is made by one thread at a time:
//
//   kept            Find returns it
//   in the making   wait for made_, then look again
//   else            reserve bytes, make it, keep it, wake the others
//
// A thread that makes a unit may compute in parallel. It is isolated meanwhile: TBB gives it no other
// task, which could wait for this very unit.

#include "core/indexed/unit_cache.h"

#include <algorithm>
#include <iterator>

#include "absl/strings/str_format.h"
#include "oneapi/tbb/task_arena.h"

#include "core/base/cancellation.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"

namespace isoscope::indexed {

absl::StatusOr<std::shared_ptr<const std::string>> UnitCache::Get(
    const Key& key, std::size_t size, std::size_t decoded_bytes,
    absl::FunctionRef<absl::Status(char* out)> make) {
  {
    const base::MutexLock lock(&mutex_);
    for (;;) {
      if (std::shared_ptr<const std::string> unit = Find(key); unit != nullptr) {
        return unit;
      }
      if (in_the_making_.insert(key).second) {
        break;
      }
      made_.Await(&mutex_, [&]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
        return !in_the_making_.contains(key);
      });
    }
  }
  // Also if an exception comes.
  class Making {
   public:
    Making(UnitCache* cache, const Key& key) : cache_(*cache), key_(key) {}
    ~Making() {
      const base::MutexLock lock(&cache_.mutex_);
      cache_.in_the_making_.erase(key_);
      cache_.made_.SignalAll();
    }
    Making(const Making&) = delete;
    Making& operator=(const Making&) = delete;

   private:
    UnitCache& cache_;
    const Key& key_;
  };
  const Making making(this, key);
  const base::Cancellation never;  // others that make units end soon
  const std::size_t whole = std::max(size, decoded_bytes);
  absl::StatusOr<base::MemoryBudget::Reservation> bytes =
      making_.Reserve(kMakingFactor * whole, never);
  if (absl::IsResourceExhausted(bytes.status())) {
    return absl::ResourceExhaustedError(absl::StrFormat(
        "chunks of %.1f MiB need %.0f MiB while they are decoded, and %.0f MiB are for that: raise "
        "--memory-limit, or write the source with smaller chunks",
        static_cast<double>(whole) / double{base::kMiB},
        static_cast<double>(kMakingFactor * whole) / double{base::kMiB},
        static_cast<double>(making_.capacity_bytes()) / double{base::kMiB}));
  }
  ISOSCOPE_RETURN_IF_ERROR(bytes.status());
  const auto unit = std::make_shared<std::string>(size, '\0');
  ISOSCOPE_RETURN_IF_ERROR(tbb::this_task_arena::isolate([&] { return make(unit->data()); }));
  const base::MutexLock lock(&mutex_);
  ++made_count_;
  Keep(key, unit);
  return std::shared_ptr<const std::string>(unit);
}

std::shared_ptr<const std::string> UnitCache::Find(const Key& key) {
  const auto found = places_.find(key);
  if (found == places_.end()) {
    return nullptr;
  }
  entries_.splice(entries_.begin(), entries_, found->second);
  return found->second->unit;
}

void UnitCache::Keep(const Key& key, const std::shared_ptr<const std::string>& unit) {
  if (unit->size() > max_kept_bytes_) {
    return;
  }
  while (kept_bytes_ + unit->size() > max_kept_bytes_) {
    const auto last = std::prev(entries_.end());
    kept_bytes_ -= last->unit->size();
    places_.erase(last->key);
    entries_.erase(last);
  }
  std::list<Entry> added;
  added.push_front({key, unit});
  places_.emplace(key, added.begin());
  entries_.splice(entries_.begin(), added);
  kept_bytes_ += unit->size();
}

std::size_t UnitCache::kept_bytes() const {
  const base::MutexLock lock(&mutex_);
  return kept_bytes_;
}

std::int64_t UnitCache::made_count() const {
  const base::MutexLock lock(&mutex_);
  return made_count_;
}

}  // namespace isoscope::indexed
