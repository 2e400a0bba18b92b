#include "core/base/process_interrupt.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <memory>
#include <set>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "core/base/mutex.h"
#include "core/base/thread_interrupt.h"

namespace isoscope::base {
namespace {

using Clock = std::chrono::steady_clock;

std::atomic<const Cancellation*> installed_interrupt{nullptr};

// Both are never destroyed: a thread may end the process while others run.
struct UnfinishedPaths {
  Mutex mutex;
  std::multiset<std::string> paths ABSL_GUARDED_BY(mutex);
};
UnfinishedPaths& Unfinished() {
  static auto* const paths = new UnfinishedPaths();
  return *paths;
}

struct OrderlyEnds {
  Mutex mutex;
  std::multiset<Clock::time_point> ends ABSL_GUARDED_BY(mutex);  // when each must be over
};
OrderlyEnds& Ends() {
  static auto* const ends = new OrderlyEnds();
  return *ends;
}

}  // namespace

const Cancellation& InterruptOfAllThreads() {
  static const auto* const never = new Cancellation();
  const Cancellation* const installed = installed_interrupt.load();
  return installed != nullptr ? *installed : *never;
}

// On a thread with a ThreadInterrupt that one, which also fires with the interrupt of the process.
const Cancellation& ProcessInterrupt() {
  const Cancellation* const of_thread = ThreadInterrupt::OfThread();
  return of_thread != nullptr ? *of_thread : InterruptOfAllThreads();
}

absl::Status CheckProcessInterrupt() {
  return ProcessInterrupt().is_cancelled() ? absl::CancelledError("interrupted") : absl::OkStatus();
}

void SetProcessInterrupt(const Cancellation* interrupt) { installed_interrupt.store(interrupt); }

UnfinishedPath::UnfinishedPath(std::string path) : path_(std::move(path)) {
  const MutexLock lock(&Unfinished().mutex);
  Unfinished().paths.insert(path_);
}

UnfinishedPath::~UnfinishedPath() {
  const MutexLock lock(&Unfinished().mutex);
  std::multiset<std::string>& paths = Unfinished().paths;
  paths.erase(paths.find(path_));
}

void RemoveUnfinishedPaths(absl::Duration patience) {
  std::vector<std::string> paths;
  {
    const MutexLock lock(&Unfinished().mutex);
    paths.assign(Unfinished().paths.begin(), Unfinished().paths.end());
  }
  if (paths.empty()) {
    return;
  }
  const auto is_done = std::make_shared<std::atomic<bool>>(false);
  std::thread([paths, is_done] {
    for (const std::string& path : paths) {
      std::error_code error;
      std::filesystem::remove_all(path, error);
    }
    is_done->store(true);
  }).detach();
  constexpr auto kStep = std::chrono::milliseconds(2);
  const Clock::time_point end = Clock::now() + absl::ToChronoNanoseconds(patience);
  while (!is_done->load() && Clock::now() < end) {
    std::this_thread::sleep_for(kStep);
  }
}

OrderlyEnd::OrderlyEnd(absl::Duration at_most)
    : end_(Clock::now() + absl::ToChronoNanoseconds(at_most)) {
  const MutexLock lock(&Ends().mutex);
  Ends().ends.insert(end_);
}

OrderlyEnd::~OrderlyEnd() {
  const MutexLock lock(&Ends().mutex);
  std::multiset<Clock::time_point>& ends = Ends().ends;
  ends.erase(ends.find(end_));
}

bool OrderlyEnd::IsUnderWay() {
  OrderlyEnds& all = Ends();
  const MutexLock lock(&all.mutex);
  return !all.ends.empty() && Clock::now() < *all.ends.rbegin();
}

}  // namespace isoscope::base
