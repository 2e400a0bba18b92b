// Many reads of files at once: while some are worked on, the next are under way. What the system
// holds in memory is read by who asks, at the price of a system call; the rest by io_uring where
// the kernel allows it, else by threads that block in pread. Both give the same bytes and errors.

#ifndef ISOSCOPE_CORE_IO_READ_QUEUE_H_
#define ISOSCOPE_CORE_IO_READ_QUEUE_H_

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/mutex.h"
#include "core/base/units.h"
#include "core/io/file.h"

namespace isoscope::io {

enum class ReadBackend {
  kAutomatic,  // what the environment variable ISOSCOPE_READ_BACKEND says ("io_uring" or
               // "threads"); io_uring if it says nothing
  kIoUring,    // kThreads where the kernel refuses it
  kThreads
};

// Whether this process may use io_uring: containers often may not. Costs some system calls.
bool IoUringIsAvailable();

struct ReadQueueOptions {
  ReadBackend backend = ReadBackend::kAutomatic;
  // Bounds of what is under way or has arrived and is not released. One read may be larger, alone.
  // More lets slow disks keep up with fast processors; memory grows with it.
  std::size_t max_bytes = 16 * static_cast<std::size_t>(base::kMiB);
  std::size_t max_requests = 256;
  // What one system call moves. Linux stops at 2^31 - 4096; tests stop earlier.
  std::size_t max_transfer_bytes = static_cast<std::size_t>(base::kGiB);
};

// Reads a list, each once. Thread-safe. Threads call TryTake until it gives nothing, then one waits
// with WaitForMore. Nothing is started before the first TryTake, and no thread or ring is made
// while all is found in memory.
class ReadQueue {
 private:
  struct Slot;

 public:
  struct Read {
    const RandomAccessFile* file = nullptr;
    std::int64_t offset = 0;
    std::size_t size = 0;
  };

  // One read that ended. Releases its buffer when it is destroyed.
  class Arrival {
   public:
    Arrival(Arrival&& other) noexcept;
    Arrival& operator=(Arrival&&) = delete;
    ~Arrival();

    // Which of the reads.
    [[nodiscard]] std::size_t index() const;
    // As RandomAccessFile::ReadAt.
    [[nodiscard]] const absl::Status& status() const;
    // The read's bytes, if status() is OK.
    [[nodiscard]] const char* data() const;

   private:
    friend class ReadQueue;
    Arrival(ReadQueue* queue, std::unique_ptr<Slot> slot);

    ReadQueue* queue_;
    std::unique_ptr<Slot> slot_;
  };

  // Files outlive the queue, the queue its arrivals.
  explicit ReadQueue(std::vector<Read> reads, const ReadQueueOptions& options = {});
  // Starts nothing more, cancels what can be, and waits for the reads under way.
  ~ReadQueue();
  ReadQueue(const ReadQueue&) = delete;
  ReadQueue& operator=(const ReadQueue&) = delete;

  // Starts reads while the bounds allow, and gives one that ended: in any order. Nothing if none
  // has. Never waits for a disk. After some reads that were not in memory the next ones are started
  // together, a quarter of the bounds at a time.
  std::optional<Arrival> TryTake();

  // Waits until TryTake may give something again: true; false when every read was taken. The error
  // of `cancellation` as soon as it fires. REQUIRES: the calling thread holds no
  // arrival.
  absl::StatusOr<bool> WaitForMore(const base::Cancellation& cancellation);

  // Bytes of buffers, at most so far.
  [[nodiscard]] std::size_t peak_bytes() const;
  // What reads that were not found in memory use; kAutomatic as long as there was none.
  [[nodiscard]] ReadBackend backend_in_use() const;

 private:
  class Ring;

  bool HasMore() const ABSL_SHARED_LOCKS_REQUIRED(mutex_);
  // Whether the next read may be begun, if there is room: from cold files many wait for each other.
  bool MayBegin() const ABSL_SHARED_LOCKS_REQUIRED(mutex_);
  bool HasRoom(std::size_t size) const ABSL_SHARED_LOCKS_REQUIRED(mutex_);
  // Null if the bounds are reached.
  std::unique_ptr<Slot> Claim(std::size_t size) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Release(std::unique_ptr<Slot> slot);
  // Hands a slot to ring or threads, and from a cold file as many others as there is room for.
  // Gives it back if there is neither and none can be made.
  std::unique_ptr<Slot> Start(std::unique_ptr<Slot> slot);
  void FillRing() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void PrepareBackend() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // The bytes of a slot that are still missing, with pread.
  void ReadRest(Slot* slot) const;
  void RunThread();
  void RunRing();

  const std::vector<Read> reads_;
  const ReadQueueOptions options_;

  mutable base::Mutex mutex_;
  base::CondVar changed_;                         // something that HasMore looks at
  base::CondVar has_work_;                        // started_ or stopping_, for the threads
  std::size_t next_ ABSL_GUARDED_BY(mutex_) = 0;  // the first read that nobody began
  std::vector<std::unique_ptr<Slot>> free_ ABSL_GUARDED_BY(mutex_);
  std::size_t used_count_ ABSL_GUARDED_BY(mutex_) = 0;  // slots that are not free
  std::size_t used_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  std::size_t held_bytes_ ABSL_GUARDED_BY(mutex_) = 0;  // of all slots
  std::size_t peak_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  std::size_t last_fill_ ABSL_GUARDED_BY(mutex_) = 0;  // used_count_ after the last FillRing
  std::atomic<std::size_t> missed_{0};                 // reads since one was found in memory
  std::size_t waiting_threads_ ABSL_GUARDED_BY(mutex_) = 0;
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::deque<std::unique_ptr<Slot>> started_ ABSL_GUARDED_BY(mutex_);  // ring or threads take them
  std::deque<std::unique_ptr<Slot>> arrived_ ABSL_GUARDED_BY(mutex_);
  ReadBackend backend_ ABSL_GUARDED_BY(mutex_) = ReadBackend::kAutomatic;
  std::vector<std::thread> threads_ ABSL_GUARDED_BY(mutex_);
  std::unique_ptr<Ring> ring_;  // made under the lock, before the only thread that uses it
};

}  // namespace isoscope::io

#endif  // ISOSCOPE_CORE_IO_READ_QUEUE_H_
