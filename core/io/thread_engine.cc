// Reads with pread on some threads, each of which takes one read at a time.

#include <exception>
#include <thread>
#include <utility>

#include "core/base/no_memory.h"
#include "core/io/read_engine.h"
#include "core/io/transfers.h"

namespace isoscope::io {
namespace {

absl::Status TryReadRest(std::size_t max_transfer_bytes, ReadSlot* slot) {
  const FileRead& read = *slot->read;
  const int descriptor = read.file->descriptor();
  if (descriptor < 0) {
    return read.file->ReadAt(read.offset, read.size, slot->buffer.get());
  }
  const int error = ReadFully(descriptor, read.offset, read.size, slot->buffer.get(), &slot->done,
                              max_transfer_bytes);
  if (error != 0) {
    return ReadFailed(error, *read.file, read.offset, read.size);
  }
  return slot->done == read.size
             ? absl::OkStatus()
             : FileTooShort(*read.file, read.offset, read.size,
                            read.offset + static_cast<std::int64_t>(slot->done));
}

class ThreadEngine final : public ReadEngine {
 public:
  ThreadEngine(ReadExchange* exchange, std::size_t max_threads, std::size_t max_transfer_bytes)
      : exchange_(*exchange), max_threads_(max_threads), max_transfer_bytes_(max_transfer_bytes) {}
  ~ThreadEngine() override {
    {
      const base::MutexLock lock(&exchange_.mutex);
      has_work_.SignalAll();
    }
    for (std::thread& thread : threads_) {
      thread.join();
    }
  }

  bool HasThread() override ABSL_EXCLUSIVE_LOCKS_REQUIRED(exchange_.mutex) {
    if (waiting_count_ <= exchange_.started.size() && threads_.size() < max_threads_) {
      try {
        threads_.emplace_back(&ThreadEngine::Run, this);
      } catch (const std::exception&) {  // too many threads in the system, or no memory for one
      }
    }
    return !threads_.empty();
  }
  void Announce(bool /*is_first*/) override { has_work_.Signal(); }
  [[nodiscard]] bool takes_batches() const override { return false; }

 private:
  void Run() {
    while (true) {
      std::unique_ptr<ReadSlot> slot;
      {
        const base::MutexLock lock(&exchange_.mutex);
        ++waiting_count_;
        has_work_.Await(&exchange_.mutex, [this]() ABSL_SHARED_LOCKS_REQUIRED(exchange_.mutex) {
          return exchange_.is_stopping || !exchange_.started.empty();
        });
        --waiting_count_;
        if (exchange_.is_stopping) {
          return;
        }
        slot = TakeFirst(&exchange_.started);
      }
      ReadRest(max_transfer_bytes_, slot.get());
      const base::MutexLock lock(&exchange_.mutex);
      exchange_.arrived.push_back(std::move(slot));
      exchange_.changed.SignalAll();
    }
  }

  ReadExchange& exchange_;
  const std::size_t max_threads_;
  const std::size_t max_transfer_bytes_;
  base::CondVar has_work_;
  std::size_t waiting_count_ ABSL_GUARDED_BY(exchange_.mutex) = 0;
  std::vector<std::thread> threads_;  // only the queue's callers change it, under the lock
};

}  // namespace

std::unique_ptr<ReadSlot> TakeFirst(ReadSlots* slots) {
  std::unique_ptr<ReadSlot> slot = std::move(slots->front());
  slots->erase(slots->begin());
  return slot;
}

void ReadRest(std::size_t max_transfer_bytes, ReadSlot* slot) noexcept {
  slot->status = base::OrNoMemory("a read", [&] { return TryReadRest(max_transfer_bytes, slot); });
}

std::unique_ptr<ReadEngine> MakeThreadEngine(ReadExchange* exchange, std::size_t max_threads,
                                             std::size_t max_transfer_bytes) {
  return std::make_unique<ThreadEngine>(exchange, max_threads, max_transfer_bytes);
}

}  // namespace isoscope::io
