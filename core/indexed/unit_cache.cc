// A unit is made by one thread at a time:
//
//   kept            Find returns it
//   in the making   wait for made_, and take what came of it
//   else            reserve bytes, make it, keep it, wake the others
//
// A thread that makes a unit may compute in parallel. It is isolated meanwhile: TBB gives it no other
// task, which could wait for this very unit.

#include "core/indexed/unit_cache.h"

#include <algorithm>
#include <iterator>

#include "absl/strings/str_format.h"
#include "oneapi/tbb/task_arena.h"

#include "core/base/error_reason.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"

namespace isoscope::indexed {

class UnitCache::MakingScope {
 public:
  MakingScope(UnitCache* cache, const Key& key, std::shared_ptr<Making> making)
      : cache_(*cache), key_(key), making_(std::move(making)) {}
  ~MakingScope() {  // also if an exception comes
    const base::MutexLock lock(&cache_.mutex_);
    making_->has_ended = true;
    cache_.in_the_making_.erase(key_);
    cache_.made_.SignalAll();
  }
  MakingScope(const MakingScope&) = delete;
  MakingScope& operator=(const MakingScope&) = delete;

 private:
  UnitCache& cache_;
  const Key key_;
  const std::shared_ptr<Making> making_;
};

absl::StatusOr<std::shared_ptr<const std::string>> UnitCache::Get(
    const Key& key, std::size_t size, std::size_t decoded_bytes,
    const base::Cancellation& cancellation, absl::FunctionRef<absl::Status(char* out)> make) {
  for (;;) {
    std::shared_ptr<Making> making;
    bool is_maker = false;
    {
      const base::MutexLock lock(&mutex_);
      if (std::shared_ptr<const std::string> unit = Find(key); unit != nullptr) {
        return unit;
      }
      std::shared_ptr<Making>& entry = in_the_making_[key];
      if (entry == nullptr) {
        entry = std::make_shared<Making>();
        is_maker = true;
      }
      making = entry;
    }
    if (is_maker) {
      const MakingScope scope(this, key, making);
      making->unit = Make(key, size, decoded_bytes, cancellation, make);
      return making->unit;
    }
    ISOSCOPE_RETURN_IF_ERROR(base::AwaitOrCancelled(cancellation, &mutex_, &made_,
                                                    [&making] { return making->has_ended; }));
    const absl::Status& status = making->unit.status();
    if (!absl::IsCancelled(status) && !absl::IsDeadlineExceeded(status)) {
      return making->unit;
    }
  }
}

absl::StatusOr<std::shared_ptr<const std::string>> UnitCache::Make(
    const Key& key, std::size_t size, std::size_t decoded_bytes,
    const base::Cancellation& cancellation, absl::FunctionRef<absl::Status(char* out)> make) {
  const std::size_t whole = std::max(size, decoded_bytes);
  absl::StatusOr<base::MemoryBudget::Reservation> bytes =
      making_.Reserve(kMakingFactor * whole, cancellation);
  if (absl::IsResourceExhausted(bytes.status())) {
    return base::WithReason(
        absl::ResourceExhaustedError(absl::StrFormat(
            "chunks of %.1f MiB need %.0f MiB while they are decoded, and %.0f MiB are for that: "
            "raise --memory-limit, or write the source with smaller chunks",
            static_cast<double>(whole) / double{base::kMiB},
            static_cast<double>(kMakingFactor * whole) / double{base::kMiB},
            static_cast<double>(making_.capacity_bytes()) / double{base::kMiB})),
        base::ErrorReason::kTooLarge);
  }
  ISOSCOPE_RETURN_IF_ERROR(bytes.status());
  {
    const base::MutexLock lock(&mutex_);
    MakeRoom(0);
  }
  const auto unit = std::make_shared<std::string>(size, '\0');
  ISOSCOPE_RETURN_IF_ERROR(tbb::this_task_arena::isolate([&] { return make(unit->data()); }));
  const base::MutexLock lock(&mutex_);
  ++made_count_;
  Keep(key, unit);
  return std::shared_ptr<const std::string>(unit);
}

bool UnitCache::Has(const Key& key) const {
  const base::MutexLock lock(&mutex_);
  return places_.contains(key) || in_the_making_.contains(key);
}

std::shared_ptr<const std::string> UnitCache::Find(const Key& key) {
  const auto found = places_.find(key);
  if (found == places_.end()) {
    return nullptr;
  }
  const std::list<Entry>::iterator entry = found->second;
  if (entry->is_doubtful && base::MonotonicNow() - entry->made >= kDoubtfulLife) {
    Drop(entry);
    return nullptr;
  }
  entries_.splice(entries_.begin(), entries_, entry);
  return entry->unit;
}

void UnitCache::MakeRoom(std::size_t bytes) {
  const std::size_t max_bytes = max_bytes_ - making_.reserved_bytes();
  while (kept_bytes_ + bytes > max_bytes && !entries_.empty()) {
    Drop(std::prev(entries_.end()));
  }
}

void UnitCache::Drop(std::list<Entry>::iterator entry) {
  kept_bytes_ -= entry->unit->size();
  places_.erase(entry->key);
  entries_.erase(entry);
}

void UnitCache::Doubt(const Key& key) {
  const base::MutexLock lock(&mutex_);
  if (const auto found = places_.find(key); found != places_.end()) {
    found->second->is_doubtful = true;
  }
}

void UnitCache::Keep(const Key& key, const std::shared_ptr<const std::string>& unit) {
  if (unit->size() > least_kept_bytes()) {
    return;
  }
  MakeRoom(unit->size());
  std::list<Entry> added;
  added.push_front({.key = key, .unit = unit, .made = base::MonotonicNow()});
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
