// The life of a slot, which is a buffer on its way through the queue:
//
//   state      held by               next
//   free       free_                 Claim: a read is due and the bounds leave room
//   claimed    the caller of TryTake arrival, if memory had all bytes; else Start
//   started    exchange_.started     a thread of the engine takes it
//   under way  that thread           its last byte, or its error, has come
//   arrived    exchange_.arrived     TryTake gives it out
//   arrival    Arrival               ~Arrival releases it: free again
//
// A read takes the cheapest way that works. TryTake copies the bytes that the system holds in
// memory. io_uring (ring_engine.cc), or pread on some threads (thread_engine.cc), reads the others.
// If no thread can be made, the caller reads by itself. read_pacer.h says when a read may begin.
//
// The exchange's mutex guards the lists. Nobody holds it while bytes are read.
//
// Memory may run out. Then TryTake throws, or continues with the existing buffers and threads.
// Arrival's destructor and the threads of the engine allocate nothing: the lists have room for
// every slot that Claim has made, and ReadRest turns an exception into the status of its read.

#include "core/io/read_queue.h"

#include <algorithm>
#include <cstdlib>
#include <iterator>
#include <new>
#include <utility>

#include "absl/strings/string_view.h"

#include "core/base/check.h"
#include "core/base/no_memory.h"
#include "core/base/status_macros.h"

namespace isoscope::io {
namespace {

ReadBackend Resolve(ReadBackend backend) {
  if (backend != ReadBackend::kAutomatic) {
    return backend;
  }
  // NOLINTNEXTLINE(concurrency-mt-unsafe): the programs never change their environment
  const char* const text = std::getenv("ISOSCOPE_READ_BACKEND");
  return text != nullptr && absl::string_view(text) == "threads" ? ReadBackend::kThreads
                                                                 : ReadBackend::kIoUring;
}

}  // namespace

ReadQueue::Arrival::~Arrival() {
  if (slot_ != nullptr) {
    queue_->Release(std::move(slot_));
  }
}

ReadQueue::ReadQueue(std::vector<Read> reads, const ReadQueueOptions& options)
    : reads_(std::move(reads)), options_(options), pacer_(options.max_bytes, options.max_requests) {
  ISOSCOPE_CHECK_GE(options_.max_requests, 1U);
  ISOSCOPE_CHECK_GE(options_.max_transfer_bytes, 1U);
}

ReadQueue::~ReadQueue() {
  {
    const base::MutexLock lock(&exchange_.mutex);
    exchange_.is_stopping = true;
  }
  engine_.reset();
}

std::size_t ReadQueue::peak_bytes() const {
  const base::MutexLock lock(&exchange_.mutex);
  return peak_bytes_;
}

ReadBackend ReadQueue::backend_in_use() const {
  const base::MutexLock lock(&exchange_.mutex);
  return backend_;
}

std::unique_ptr<ReadSlot> ReadQueue::Claim() {
  const std::size_t capacity = ReadPacer::BufferBytesFor(reads_[next_].size);
  if (!pacer_.HasRoom(capacity)) {
    return nullptr;
  }
  std::unique_ptr<ReadSlot> slot;
  // The buffer that was used last is most likely in the processor's cache.
  const auto fits =
      std::find_if(free_.rbegin(), free_.rend(),
                   [&](const auto& candidate) ABSL_SHARED_LOCKS_REQUIRED(exchange_.mutex) {
                     return candidate->capacity >= capacity && pacer_.HasRoom(candidate->capacity);
                   });
  if (fits != free_.rend()) {
    slot = std::move(*fits);
    free_.erase(std::next(fits).base());
  } else {
    while (!free_.empty() && held_bytes_ + capacity > options_.max_bytes) {
      held_bytes_ -= free_.front()->capacity;
      free_.erase(free_.begin());
      --slot_count_;
    }
    slot = std::make_unique<ReadSlot>();
    slot->buffer = std::make_unique_for_overwrite<char[]>(capacity);
    slot->capacity = capacity;
    ReserveLists(slot_count_ + 1);
    ++slot_count_;
    held_bytes_ += capacity;
    peak_bytes_ = std::max(peak_bytes_, held_bytes_);
  }
  pacer_.Begin(slot->capacity);
  slot->index = next_++;
  slot->read = &reads_[slot->index];
  slot->done = 0;
  slot->status = absl::OkStatus();
  return slot;
}

void ReadQueue::ReserveLists(std::size_t count) {
  for (ReadSlots* slots : {&free_, &exchange_.started, &exchange_.arrived}) {
    if (slots->capacity() < count) {
      slots->reserve(std::max(count, 2 * slots->capacity()));
    }
  }
}

void ReadQueue::Release(std::unique_ptr<ReadSlot> slot) {
  const base::MutexLock lock(&exchange_.mutex);
  pacer_.End(slot->capacity);
  free_.push_back(std::move(slot));
  exchange_.changed.SignalAll();
}

std::optional<ReadQueue::Arrival> ReadQueue::TryTake() {
  while (true) {
    std::unique_ptr<ReadSlot> slot;
    {
      const base::MutexLock lock(&exchange_.mutex);
      if (next_ < reads_.size() && pacer_.IsDue()) {
        slot = Claim();
      }
      if (slot == nullptr) {
        if (exchange_.arrived.empty()) {
          return std::nullopt;
        }
        return Arrival(this, TakeFirst(&exchange_.arrived));
      }
    }
    const Read& read = *slot->read;
    slot->status = CheckRange(*read.file, read.offset, read.size);
    if (slot->status.ok()) {
      slot->done = read.file->ReadCached(read.offset, read.size, slot->buffer.get());
    }
    if (!slot->status.ok() || slot->done == read.size) {
      if (pacer_.RecordHit()) {
        const base::MutexLock lock(&exchange_.mutex);
        exchange_.changed.SignalAll();
      }
      return Arrival(this, std::move(slot));
    }
    pacer_.RecordMiss();
    slot = Start(std::move(slot));
    if (slot != nullptr) {
      ReadRest(options_.max_transfer_bytes, slot.get());
      return Arrival(this, std::move(slot));
    }
  }
}

absl::StatusOr<bool> ReadQueue::WaitForMore(const base::Cancellation& cancellation) {
  ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
  bool is_any_left = false;
  ISOSCOPE_RETURN_IF_ERROR(base::AwaitOrCancelled(
      cancellation, &exchange_.mutex, &exchange_.changed,
      [this, &is_any_left]() ABSL_SHARED_LOCKS_REQUIRED(exchange_.mutex) {
        const bool has_next = next_ < reads_.size();
        is_any_left = !exchange_.arrived.empty() || has_next;
        return !exchange_.arrived.empty() || pacer_.is_idle() ||
               (has_next && pacer_.IsDue() &&
                pacer_.HasRoom(ReadPacer::BufferBytesFor(reads_[next_].size)));
      }));
  return is_any_left;
}

std::unique_ptr<ReadSlot> ReadQueue::Start(std::unique_ptr<ReadSlot> slot) {
  const base::MutexLock lock(&exchange_.mutex);
  if (engine_ == nullptr) {
    MakeEngine();
  }
  if (!engine_->HasThread()) {
    return slot;
  }
  const bool is_first = exchange_.started.empty();
  exchange_.started.push_back(std::move(slot));
  if (engine_->takes_batches() && pacer_.is_cold()) {
    StartBatch();
  }
  engine_->Announce(is_first);
  return nullptr;
}

void ReadQueue::StartBatch() {
  while (next_ < reads_.size()) {
    std::unique_ptr<ReadSlot> slot;
    try {
      slot = Claim();
    } catch (const std::bad_alloc&) {
      break;  // the reads that have started give their buffers back
    }
    if (slot == nullptr) {
      break;
    }
    const Read& read = *slot->read;
    slot->status = base::OrNoMemory("the error of a read",
                                    [&] { return CheckRange(*read.file, read.offset, read.size); });
    const bool is_due = slot->status.ok() && read.size > 0;
    (is_due ? exchange_.started : exchange_.arrived).push_back(std::move(slot));
  }
  pacer_.EndBatch();
  exchange_.changed.SignalAll();
}

void ReadQueue::MakeEngine() {
  if (Resolve(options_.backend) == ReadBackend::kIoUring) {
    engine_ = MakeRingEngine(&exchange_, options_.max_requests, options_.max_transfer_bytes);
    backend_ = ReadBackend::kIoUring;
  }
  if (engine_ == nullptr) {
    engine_ = MakeThreadEngine(&exchange_, std::min(kMaxReadThreads, options_.max_requests),
                               options_.max_transfer_bytes);
    backend_ = ReadBackend::kThreads;
  }
}

}  // namespace isoscope::io
