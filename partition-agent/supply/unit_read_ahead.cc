#include "partition-agent/supply/unit_read_ahead.h"

#include <algorithm>
#include <exception>
#include <utility>

#include "absl/status/status.h"

#include "core/base/no_memory.h"

namespace isoscope::agent {

UnitReadAhead::UnitReadAhead(std::vector<Unit> units, const base::Cancellation& cancellation)
    : units_(std::move(units)),
      ended_(cancellation.deadline()),
      frame_ends_(cancellation, [this] { ended_.Cancel(); }) {
  if (!units_.empty()) {
    max_ahead_ = units_.front().reader->max_units_ahead();
  }
  const std::size_t thread_count = std::min({kMaxThreads, max_ahead_, units_.size()});
  threads_.reserve(thread_count);
  try {
    while (threads_.size() < thread_count) {
      threads_.emplace_back(&UnitReadAhead::Run, this);
    }
  } catch (const std::exception&) {  // too many threads in the system: fewer, or none, do
  }
}

UnitReadAhead::~UnitReadAhead() {
  ended_.Cancel();
  for (std::thread& thread : threads_) {
    thread.join();
  }
}

void UnitReadAhead::HasUsed(std::size_t count) {
  const base::MutexLock lock(&mutex_);
  if (count > used_count_) {
    used_count_ = count;
    changed_.SignalAll();
  }
}

void UnitReadAhead::Run() {
  for (;;) {
    const Unit* unit = nullptr;
    const absl::Status may_go_on = base::AwaitOrCancelled(
        ended_, &mutex_, &changed_, [&]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
          if (next_ == units_.size() || has_failed_) {
            return true;
          }
          if (next_ >= used_count_ + max_ahead_) {
            return false;
          }
          unit = &units_[next_++];
          return true;
        });
    if (!may_go_on.ok() || unit == nullptr) {
      return;
    }
    const absl::Status status = base::OrNoMemory(
        "a unit ahead", [&] { return unit->reader->ReadUnit(unit->index, ended_); });
    if (!status.ok()) {
      const base::MutexLock lock(&mutex_);
      has_failed_ = true;
      changed_.SignalAll();
      return;
    }
  }
}

}  // namespace isoscope::agent
