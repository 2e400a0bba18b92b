// Reads many stretches of files: while the caller works on some, others are being read. The caller
// copies the bytes that the system holds in memory, for one system call. io_uring reads the others,
// or threads that block in pread where the kernel refuses it. All give the same bytes and errors.

#ifndef ISOSCOPE_CORE_IO_READ_QUEUE_H_
#define ISOSCOPE_CORE_IO_READ_QUEUE_H_

#include <cstddef>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/units.h"
#include "core/io/read_engine.h"
#include "core/io/read_pacer.h"

namespace isoscope::io {

enum class ReadBackend {
  kAutomatic,  // as the environment variable ISOSCOPE_READ_BACKEND says ("io_uring" or "threads"),
               // io_uring if it is not set
  kIoUring,    // kThreads where the kernel refuses it
  kThreads
};

// Returns true if this process may use io_uring; containers often may not. Costs some system calls.
bool IoUringIsAvailable();

struct ReadQueueOptions {
  ReadBackend backend = ReadBackend::kAutomatic;
  // The bounds of all buffers that are not free. A larger read may run alone. Larger bounds let
  // slow disks keep up with fast processors, and take more memory.
  std::size_t max_bytes = 16 * static_cast<std::size_t>(base::kMiB);
  std::size_t max_requests = 256;
  // The most bytes of one system call. Linux stops at 2^31 - 4096; tests stop earlier.
  std::size_t max_transfer_bytes = static_cast<std::size_t>(base::kGiB);
};

// Reads each stretch of a list once. Thread-safe. Threads call TryTake until it returns nothing.
// Then one of them calls WaitForMore. No read starts before the first TryTake. As long as all bytes
// are found in memory, the queue makes no thread and no ring.
class ReadQueue {
 public:
  using Read = FileRead;

  // One read that ended. Releases its buffer when it is destroyed.
  class Arrival {
   public:
    Arrival(Arrival&& other) noexcept = default;
    Arrival& operator=(Arrival&&) = delete;
    ~Arrival();

    // Returns the index of the read in the list.
    [[nodiscard]] std::size_t index() const { return slot_->index; }
    // Returns the status that RandomAccessFile::ReadAt would return.
    [[nodiscard]] const absl::Status& status() const { return slot_->status; }
    // Returns the bytes of the read. REQUIRES: status() is OK.
    [[nodiscard]] const char* data() const { return slot_->buffer.get(); }

   private:
    friend class ReadQueue;
    Arrival(ReadQueue* queue, std::unique_ptr<ReadSlot> slot)
        : queue_(queue), slot_(std::move(slot)) {}

    ReadQueue* queue_;
    std::unique_ptr<ReadSlot> slot_;
  };

  // The files outlive the queue, and the queue outlives its arrivals.
  explicit ReadQueue(std::vector<Read> reads, const ReadQueueOptions& options = {});
  // Starts no more reads, cancels those that can be cancelled, and waits for the others.
  ~ReadQueue();
  ReadQueue(const ReadQueue&) = delete;
  ReadQueue& operator=(const ReadQueue&) = delete;

  // Starts reads while the bounds allow, and returns one that has ended, in any order; nothing if
  // none has. Never waits for a disk, unless no thread can be made. From cold files the next reads
  // start together, a quarter of the bounds at a time. If it throws std::bad_alloc, a read may be
  // lost: destroy the queue.
  std::optional<Arrival> TryTake();

  // Waits until TryTake may return a read again. True if there may be one, false if every read was
  // taken. The error of `cancellation` as soon as it fires. REQUIRES: the calling thread holds no
  // arrival.
  absl::StatusOr<bool> WaitForMore(const base::Cancellation& cancellation);

  // Returns the most bytes that the buffers have had.
  [[nodiscard]] std::size_t peak_bytes() const;
  // Returns the back end of reads that were not in memory. kAutomatic if there was none yet.
  [[nodiscard]] ReadBackend backend_in_use() const;

 private:
  // Takes a slot for the next read. Null if the bounds are reached. May throw std::bad_alloc, and
  // changes nothing then.
  std::unique_ptr<ReadSlot> Claim() ABSL_EXCLUSIVE_LOCKS_REQUIRED(exchange_.mutex);
  // Gives each list room for `count` slots, so that nothing that moves a slot throws.
  void ReserveLists(std::size_t count) ABSL_EXCLUSIVE_LOCKS_REQUIRED(exchange_.mutex);
  void Release(std::unique_ptr<ReadSlot> slot);
  // Hands a slot to the engine, and of cold files as many others as there is room for. Returns the
  // slot if there is no thread and none can be made.
  std::unique_ptr<ReadSlot> Start(std::unique_ptr<ReadSlot> slot);
  void StartBatch() ABSL_EXCLUSIVE_LOCKS_REQUIRED(exchange_.mutex);
  void MakeEngine() ABSL_EXCLUSIVE_LOCKS_REQUIRED(exchange_.mutex);

  const std::vector<Read> reads_;
  const ReadQueueOptions options_;

  mutable ReadExchange exchange_;
  // Hits and misses are recorded without the lock. Everything else needs it.
  ReadPacer pacer_;
  std::size_t next_ ABSL_GUARDED_BY(exchange_.mutex) = 0;  // the first read that nobody began
  ReadSlots free_ ABSL_GUARDED_BY(exchange_.mutex);
  std::size_t slot_count_ ABSL_GUARDED_BY(exchange_.mutex) = 0;  // free or not, and their bytes
  std::size_t held_bytes_ ABSL_GUARDED_BY(exchange_.mutex) = 0;
  std::size_t peak_bytes_ ABSL_GUARDED_BY(exchange_.mutex) = 0;
  ReadBackend backend_ ABSL_GUARDED_BY(exchange_.mutex) = ReadBackend::kAutomatic;
  std::unique_ptr<ReadEngine> engine_;  // made under the lock
};

}  // namespace isoscope::io

#endif  // ISOSCOPE_CORE_IO_READ_QUEUE_H_
