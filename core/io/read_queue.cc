// The life of a slot, which is a buffer on its way through the queue:
//
//   state      held by               next
//   free       free_                 Claim: a read is due and the bounds leave room
//   claimed    the caller of TryTake arrival, if memory had all bytes; else Start
//   started    started_              the ring's thread, or one of the reading threads, takes it
//   under way  that thread           its last byte, or its error, has come
//   arrived    arrived_              TryTake gives it out
//   arrival    Arrival               ~Arrival releases it: free again
//
// A read takes the shortest way that works. TryTake copies the bytes that the system holds in
// memory. io_uring, or pread on at most kMaxThreads threads, reads the others. If no thread can be
// made, the caller reads by itself. A short read goes on with its rest; EAGAIN from io_uring
// falls back to pread.
//
// Cold files. Trying memory first is a system call, and reads that start one by one are submitted
// one by one. After kColdReads misses in a row the files are taken to be cold. With io_uring,
// FillRing then starts reads without trying memory until the bounds are reached. The next ones wait
// until a quarter of those slots is free again (MayBegin). One hit ends this.
//
// mutex_ guards free_, started_ and arrived_. Nobody holds it while bytes are read.
//
// Memory may run out. Then TryTake throws, or goes on with the buffers and threads that there are.
// Arrival's destructor and the threads of the queue allocate nothing: the lists have room for every
// slot that Claim has made, and ReadRest turns an exception into the status of its read.

#include "core/io/read_queue.h"

#include <liburing.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <exception>
#include <iterator>
#include <new>
#include <utility>

#include "absl/strings/string_view.h"
#include <sys/eventfd.h>

#include "core/base/check.h"
#include "core/base/no_memory.h"
#include "core/base/status_macros.h"

namespace isoscope::io {
namespace {

// The most threads that block in pread. They keep a disk busy with merged reads.
constexpr std::size_t kMaxThreads = 8;
// Buffer sizes are multiples of this, so that reads of similar sizes can use the same buffers.
constexpr std::size_t kBufferStepBytes = 64 * static_cast<std::size_t>(base::kKiB);
// After this many reads in a row that were not in memory, the files are taken to be cold.
constexpr std::size_t kColdReads = 8;

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

struct ReadQueue::Slot {
  std::size_t index = 0;
  std::size_t done = 0;  // bytes read
  absl::Status status;
  std::unique_ptr<char[]> buffer;
  std::size_t capacity = 0;
};

namespace {

template <typename Slots>
auto TakeFirst(Slots* slots) {
  auto slot = std::move(slots->front());
  slots->erase(slots->begin());
  return slot;
}

}  // namespace

// The io_uring of one queue, and the event that wakes its thread.
class ReadQueue::Ring {
 public:
  // The slots that the ring's thread holds. There is room for one of each request.
  std::vector<std::unique_ptr<Slot>> fresh;      // to be queued
  std::vector<std::unique_ptr<Slot>> under_way;  // queued
  std::vector<std::unique_ptr<Slot>> ended;

  // Queues a read of the bytes of `slot` that are still missing, at most what one call moves.
  void QueueRest(const ReadQueue& queue, Slot* slot) {
    const Read& read = queue.reads_[slot->index];
    QueueRead(read.file->descriptor(), read.offset + static_cast<std::int64_t>(slot->done),
              std::min(read.size - slot->done, queue.options_.max_transfer_bytes),
              slot->buffer.get() + slot->done, slot);
  }

  // Takes what the kernel answered. Returns true if the read has ended. Otherwise it queues the
  // rest.
  bool TakeResult(const ReadQueue& queue, Slot* slot, int result, bool is_stopping) {
    const Read& read = queue.reads_[slot->index];
    if (result > 0) {
      slot->done += static_cast<std::size_t>(result);
    } else if (result == -EAGAIN && !is_stopping) {  // the kernel can't read without blocking
      queue.ReadRest(slot);
      return true;
    } else if (result != -EINTR || is_stopping) {
      slot->status = base::OrNoMemory("the error of a read", [&] {
        return result == 0 ? FileTooShort(*read.file, read.offset, read.size,
                                          read.offset + static_cast<std::int64_t>(slot->done))
                           : ReadFailed(-result, *read.file, read.offset, read.size);
      });
    }
    if (!slot->status.ok() || slot->done == read.size) {
      return true;
    }
    QueueRest(queue, slot);
    return false;
  }

  // Returns null where the kernel, or a rule of the container, refuses io_uring.
  static std::unique_ptr<Ring> Make(std::size_t max_requests) {
    std::unique_ptr<Ring> ring(new Ring);
    for (std::vector<std::unique_ptr<Slot>>* slots :
         {&ring->fresh, &ring->under_way, &ring->ended}) {
      slots->reserve(max_requests);
    }
    // There is room for each request, a cancellation of each, and the event.
    const auto entries = static_cast<unsigned>(2 * max_requests + 1);
    if (ring->event_ < 0 || io_uring_queue_init(entries, &ring->uring_, 0) != 0) {
      return nullptr;
    }
    ring->has_uring_ = true;
    io_uring_probe* const probe = io_uring_get_probe_ring(&ring->uring_);
    const bool can_read = probe != nullptr &&
                          io_uring_opcode_supported(probe, IORING_OP_READ) != 0 &&
                          io_uring_opcode_supported(probe, IORING_OP_ASYNC_CANCEL) != 0;
    io_uring_free_probe(probe);
    return can_read ? std::move(ring) : nullptr;
  }

  ~Ring() {
    if (has_uring_) {
      io_uring_queue_exit(&uring_);
    }
    if (event_ >= 0) {
      close(event_);
    }
  }
  Ring(const Ring&) = delete;
  Ring& operator=(const Ring&) = delete;

  // Thread-safe.
  void Wake() const {
    const std::uint64_t one = 1;
    ISOSCOPE_CHECK_EQ(write(event_, &one, sizeof(one)), static_cast<ssize_t>(sizeof(one)));
  }

  // Only the ring's thread calls these. Queued requests start with the next SubmitAndWait.
  void QueueWait() {
    io_uring_sqe* const sqe = NextEntry();
    io_uring_prep_read(sqe, event_, &event_count_, sizeof(event_count_), 0);
    io_uring_sqe_set_data(sqe, &event_count_);
  }
  void QueueRead(int descriptor, std::int64_t offset, std::size_t size, char* out, Slot* slot) {
    io_uring_sqe* const sqe = NextEntry();
    io_uring_prep_read(sqe, descriptor, out, static_cast<unsigned>(size),
                       static_cast<std::uint64_t>(offset));
    io_uring_sqe_set_data(sqe, slot);
  }
  void QueueCancel(Slot* slot) {
    io_uring_sqe* const sqe = NextEntry();
    io_uring_prep_cancel(sqe, slot, 0);
    io_uring_sqe_set_data(sqe, nullptr);
  }
  [[nodiscard]] bool IsWait(const void* data) const { return data == &event_count_; }

  // Starts the queued requests, waits until at least one has ended, and calls visit(data, result)
  // for each that has.
  template <typename Visit>
  void SubmitAndWait(Visit visit) {
    int result = 0;
    do {
      result = io_uring_submit_and_wait(&uring_, 1);
    } while (result == -EINTR || result == -EAGAIN || result == -EBUSY);
    ISOSCOPE_CHECK_GE(result, 0);
    unsigned head = 0;
    unsigned count = 0;
    io_uring_cqe* cqe = nullptr;
    io_uring_for_each_cqe(&uring_, head, cqe) {
      visit(io_uring_cqe_get_data(cqe), cqe->res);
      ++count;
    }
    io_uring_cq_advance(&uring_, count);
  }

 private:
  Ring() : event_(eventfd(0, EFD_CLOEXEC)) {}

  io_uring_sqe* NextEntry() {
    io_uring_sqe* sqe = io_uring_get_sqe(&uring_);
    if (sqe == nullptr) {  // many short reads go on at once
      io_uring_submit(&uring_);
      sqe = io_uring_get_sqe(&uring_);
    }
    ISOSCOPE_CHECK(sqe != nullptr);
    return sqe;
  }

  const int event_;
  std::uint64_t event_count_ = 0;
  io_uring uring_ = {};
  bool has_uring_ = false;
};

bool IoUringIsAvailable() {
  io_uring uring = {};
  if (io_uring_queue_init(1, &uring, 0) != 0) {
    return false;
  }
  io_uring_queue_exit(&uring);
  return true;
}

ReadQueue::Arrival::Arrival(ReadQueue* queue, std::unique_ptr<Slot> slot)
    : queue_(queue), slot_(std::move(slot)) {}

ReadQueue::Arrival::Arrival(Arrival&& other) noexcept = default;

ReadQueue::Arrival::~Arrival() {
  if (slot_ != nullptr) {
    queue_->Release(std::move(slot_));
  }
}

std::size_t ReadQueue::Arrival::index() const { return slot_->index; }
const absl::Status& ReadQueue::Arrival::status() const { return slot_->status; }
const char* ReadQueue::Arrival::data() const { return slot_->buffer.get(); }

ReadQueue::ReadQueue(std::vector<Read> reads, const ReadQueueOptions& options)
    : reads_(std::move(reads)), options_(options) {
  ISOSCOPE_CHECK_GE(options_.max_requests, 1U);
  ISOSCOPE_CHECK_GE(options_.max_transfer_bytes, 1U);
}

ReadQueue::~ReadQueue() {
  std::vector<std::thread> threads;
  {
    base::MutexLock lock(&mutex_);
    stopping_ = true;
    has_work_.SignalAll();
    threads = std::move(threads_);
    if (ring_ != nullptr) {
      ring_->Wake();
    }
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
}

std::size_t ReadQueue::peak_bytes() const {
  base::MutexLock lock(&mutex_);
  return peak_bytes_;
}

ReadBackend ReadQueue::backend_in_use() const {
  base::MutexLock lock(&mutex_);
  return backend_;
}

bool ReadQueue::HasRoom(std::size_t size) const {
  return used_count_ == 0 || (used_count_ < options_.max_requests && size <= options_.max_bytes &&
                              used_bytes_ <= options_.max_bytes - size);
}

std::unique_ptr<ReadQueue::Slot> ReadQueue::Claim(std::size_t size) {
  const std::size_t capacity =
      (std::max<std::size_t>(size, 1) + kBufferStepBytes - 1) / kBufferStepBytes * kBufferStepBytes;
  if (!HasRoom(capacity)) {
    return nullptr;
  }
  std::unique_ptr<Slot> slot;
  // The buffer that was used last is most likely in the processor's cache.
  const auto fits = std::find_if(
      free_.rbegin(), free_.rend(), [&](const auto& candidate) ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
        return candidate->capacity >= capacity && HasRoom(candidate->capacity);
      });
  if (fits != free_.rend()) {
    slot = std::move(*fits);
    free_.erase(std::next(fits).base());
  } else {
    while (!free_.empty() && held_bytes_ + capacity > options_.max_bytes) {
      held_bytes_ -= free_.front()->capacity;
      free_.erase(free_.begin());
    }
    slot = std::make_unique<Slot>();
    slot->buffer = std::make_unique_for_overwrite<char[]>(capacity);
    slot->capacity = capacity;
    ReserveLists();
    held_bytes_ += capacity;
    peak_bytes_ = std::max(peak_bytes_, held_bytes_);
  }
  ++used_count_;
  used_bytes_ += slot->capacity;
  slot->done = 0;
  slot->status = absl::OkStatus();
  return slot;
}

void ReadQueue::ReserveLists() {
  const std::size_t count = used_count_ + free_.size() + 1;
  for (std::vector<std::unique_ptr<Slot>>* slots : {&free_, &started_, &arrived_}) {
    if (slots->capacity() < count) {
      slots->reserve(std::max(count, 2 * slots->capacity()));
    }
  }
}

void ReadQueue::Release(std::unique_ptr<Slot> slot) {
  base::MutexLock lock(&mutex_);
  --used_count_;
  used_bytes_ -= slot->capacity;
  free_.push_back(std::move(slot));
  changed_.SignalAll();
}

std::optional<ReadQueue::Arrival> ReadQueue::TryTake() {
  while (true) {
    std::unique_ptr<Slot> slot;
    {
      base::MutexLock lock(&mutex_);
      if (MayBegin()) {
        slot = Claim(reads_[next_].size);
      }
      if (slot == nullptr) {
        if (arrived_.empty()) {
          return std::nullopt;
        }
        return Arrival(this, TakeFirst(&arrived_));
      }
      slot->index = next_++;
    }
    const Read& read = reads_[slot->index];
    slot->status = CheckRange(*read.file, read.offset, read.size);
    if (slot->status.ok()) {
      slot->done = read.file->ReadCached(read.offset, read.size, slot->buffer.get());
    }
    if (!slot->status.ok() || slot->done == read.size) {
      if (missed_.exchange(0, std::memory_order_relaxed) >= kColdReads) {
        base::MutexLock lock(&mutex_);
        changed_.SignalAll();  // MayBegin may be true now
      }
      return Arrival(this, std::move(slot));
    }
    missed_.fetch_add(1, std::memory_order_relaxed);
    slot = Start(std::move(slot));
    if (slot != nullptr) {
      ReadRest(slot.get());
      return Arrival(this, std::move(slot));
    }
  }
}

bool ReadQueue::MayBegin() const {
  // Reads of cold files begin a quarter of the slots at a time.
  return next_ < reads_.size() && (missed_.load(std::memory_order_relaxed) < kColdReads ||
                                   ring_ == nullptr || used_count_ <= last_fill_ - last_fill_ / 4);
}

bool ReadQueue::HasMore() const {
  return !arrived_.empty() || used_count_ == 0 ||
         (MayBegin() && HasRoom(reads_[next_].size + kBufferStepBytes));
}

absl::StatusOr<bool> ReadQueue::WaitForMore(const base::Cancellation& cancellation) {
  ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
  bool is_any_left = false;
  ISOSCOPE_RETURN_IF_ERROR(base::AwaitOrCancelled(
      cancellation, &mutex_, &changed_, [this, &is_any_left]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
        is_any_left = !arrived_.empty() || next_ < reads_.size();
        return HasMore();
      }));
  return is_any_left;
}

std::unique_ptr<ReadQueue::Slot> ReadQueue::Start(std::unique_ptr<Slot> slot) {
  base::MutexLock lock(&mutex_);
  if (backend_ == ReadBackend::kAutomatic) {
    PrepareBackend();
  }
  const bool wants_thread = ring_ == nullptr
                                ? waiting_threads_ <= started_.size() &&
                                      threads_.size() < std::min(kMaxThreads, options_.max_requests)
                                : threads_.empty();
  if (wants_thread) {
    try {
      threads_.emplace_back(ring_ == nullptr ? &ReadQueue::RunThread : &ReadQueue::RunRing, this);
    } catch (const std::exception&) {  // too many threads in the system, or no memory for one
      if (threads_.empty()) {
        return slot;
      }
    }
  }
  const bool ring_waits = started_.empty();
  started_.push_back(std::move(slot));
  has_work_.Signal();
  if (ring_ != nullptr) {
    if (missed_.load(std::memory_order_relaxed) >= kColdReads) {
      FillRing();
    }
    if (ring_waits) {
      ring_->Wake();
    }
  }
  return nullptr;
}

void ReadQueue::FillRing() {
  while (next_ < reads_.size()) {
    const Read& read = reads_[next_];
    std::unique_ptr<Slot> slot;
    try {
      slot = Claim(read.size);
    } catch (const std::bad_alloc&) {
      break;  // the reads that have started give their buffers back
    }
    if (slot == nullptr) {
      break;
    }
    slot->index = next_++;
    slot->status = base::OrNoMemory("the error of a read",
                                    [&] { return CheckRange(*read.file, read.offset, read.size); });
    if (slot->status.ok() && read.size > 0) {
      started_.push_back(std::move(slot));
    } else {
      arrived_.push_back(std::move(slot));
    }
  }
  last_fill_ = used_count_;
  changed_.SignalAll();
}

void ReadQueue::PrepareBackend() {
  backend_ = ReadBackend::kThreads;
  if (Resolve(options_.backend) == ReadBackend::kIoUring) {
    ring_ = Ring::Make(options_.max_requests);
    if (ring_ != nullptr) {
      backend_ = ReadBackend::kIoUring;
    }
  }
}

void ReadQueue::ReadRest(Slot* slot) const noexcept {
  slot->status = base::OrNoMemory("a read", [&] { return TryReadRest(slot); });
}

absl::Status ReadQueue::TryReadRest(Slot* slot) const {
  const Read& read = reads_[slot->index];
  const int descriptor = read.file->descriptor();
  if (descriptor < 0) {
    return read.file->ReadAt(read.offset, read.size, slot->buffer.get());
  }
  while (slot->done < read.size) {
    const ssize_t count = pread(descriptor, slot->buffer.get() + slot->done,
                                std::min(read.size - slot->done, options_.max_transfer_bytes),
                                read.offset + static_cast<std::int64_t>(slot->done));
    if (count > 0) {
      slot->done += static_cast<std::size_t>(count);
    } else if (count == 0) {
      return FileTooShort(*read.file, read.offset, read.size,
                          read.offset + static_cast<std::int64_t>(slot->done));
    } else if (errno != EINTR) {
      return ReadFailed(errno, *read.file, read.offset, read.size);
    }
  }
  return absl::OkStatus();
}

void ReadQueue::RunThread() {
  while (true) {
    std::unique_ptr<Slot> slot;
    {
      const base::MutexLock lock(&mutex_);
      ++waiting_threads_;
      has_work_.Await(&mutex_, [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
        return stopping_ || !started_.empty();
      });
      --waiting_threads_;
      if (stopping_) {
        return;
      }
      slot = TakeFirst(&started_);
    }
    ReadRest(slot.get());
    const base::MutexLock lock(&mutex_);
    arrived_.push_back(std::move(slot));
    changed_.SignalAll();
  }
}

void ReadQueue::RunRing() {
  Ring& ring = *ring_;
  bool is_stopping = false;
  ring.QueueWait();
  while (!is_stopping || !ring.under_way.empty()) {
    ring.SubmitAndWait([&](void* data, int result) {
      if (ring.IsWait(data)) {
        ring.QueueWait();
      } else if (data != nullptr &&
                 ring.TakeResult(*this, static_cast<Slot*>(data), result, is_stopping)) {
        const auto found =
            std::find_if(ring.under_way.begin(), ring.under_way.end(),
                         [&](const auto& candidate) { return candidate.get() == data; });
        ring.ended.push_back(std::move(*found));
        ring.under_way.erase(found);
      }
    });
    bool stops_now = false;
    {
      base::MutexLock lock(&mutex_);
      if (!ring.ended.empty()) {
        std::move(ring.ended.begin(), ring.ended.end(), std::back_inserter(arrived_));
        ring.ended.clear();
        changed_.SignalAll();
      }
      stops_now = stopping_ && !is_stopping;
      is_stopping = stopping_;
      if (!is_stopping) {
        std::move(started_.begin(), started_.end(), std::back_inserter(ring.fresh));
        started_.clear();
      }
    }
    if (stops_now) {
      for (const auto& slot : ring.under_way) {
        ring.QueueCancel(slot.get());
      }
    }
    for (auto& slot : ring.fresh) {
      if (reads_[slot->index].file->descriptor() >= 0) {
        ring.QueueRest(*this, slot.get());
        ring.under_way.push_back(std::move(slot));
      } else {
        ReadRest(slot.get());
        base::MutexLock lock(&mutex_);
        arrived_.push_back(std::move(slot));
        changed_.SignalAll();
      }
    }
    ring.fresh.clear();
  }
}

}  // namespace isoscope::io
