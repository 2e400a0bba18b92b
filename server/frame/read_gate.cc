#include "server/frame/read_gate.h"

namespace isoscope::server {

ReadGate::Hold ReadGate::Add(std::size_t bytes) {
  const base::MutexLock lock(&mutex_);
  waiting_bytes_ += bytes;
  return {this, bytes};
}

void ReadGate::WhenRoom(std::function<void()> read) {
  {
    const base::MutexLock lock(&mutex_);
    if (!IsOpen()) {
      readers_.push_back(std::move(read));
      return;
    }
  }
  read();
}

void ReadGate::Release(std::size_t bytes) {
  std::vector<std::function<void()>> readers;
  {
    const base::MutexLock lock(&mutex_);
    waiting_bytes_ -= bytes;
    if (IsOpen()) {
      readers.swap(readers_);
    }
  }
  for (const std::function<void()>& read : readers) {
    read();
  }
}

void ReadGate::Open() {
  {
    const base::MutexLock lock(&mutex_);
    is_always_open_ = true;
  }
  Release(0);
}

}  // namespace isoscope::server
