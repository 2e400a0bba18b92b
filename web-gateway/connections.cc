#include "web-gateway/connections.h"

#include <utility>
#include <vector>

#include "core/base/monotonic_time.h"

namespace isoscope::gateway {

std::shared_ptr<Connections::Lease> Connections::TryAdd() {
  const base::MutexLock lock(&mutex_);
  if (is_closing_ || closers_.size() >= static_cast<std::size_t>(max_count_)) {
    return nullptr;
  }
  const std::int64_t id = next_id_++;
  closers_[id] = nullptr;
  return std::make_shared<Lease>(this, id);
}

void Connections::SetCloser(std::int64_t id, Closer closer) {
  bool at_once = false;
  {
    const base::MutexLock lock(&mutex_);
    closers_[id] = closer;
    if (!is_closing_) {
      return;
    }
    at_once = is_closing_at_once_;
  }
  closer(at_once);
}

void Connections::Close(bool at_once) {
  std::vector<Closer> closers;
  {
    const base::MutexLock lock(&mutex_);
    is_closing_ = true;
    is_closing_at_once_ = is_closing_at_once_ || at_once;
    for (const auto& [id, closer] : closers_) {
      if (closer != nullptr) {
        closers.push_back(closer);
      }
    }
  }
  for (const Closer& closer : closers) {
    closer(at_once);
  }
}

bool Connections::is_closing() {
  const base::MutexLock lock(&mutex_);
  return is_closing_;
}

bool Connections::AwaitNone(base::MonotonicTime deadline) {
  base::MutexLock lock(&mutex_);
  while (!closers_.empty()) {
    if (!removed_.WaitUntil(&mutex_, deadline)) {
      return closers_.empty();
    }
  }
  return true;
}

int Connections::count() {
  const base::MutexLock lock(&mutex_);
  return static_cast<int>(closers_.size());
}

void Connections::Remove(std::int64_t id) {
  const base::MutexLock lock(&mutex_);
  closers_.erase(id);
  removed_.SignalAll();
}

}  // namespace isoscope::gateway
