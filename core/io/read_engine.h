// Reads bytes that are not in memory: threads that block in pread, or io_uring. Internal to
// ReadQueue, whose test covers both.

#ifndef ISOSCOPE_CORE_IO_READ_ENGINE_H_
#define ISOSCOPE_CORE_IO_READ_ENGINE_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"

#include "core/base/mutex.h"
#include "core/io/file.h"

namespace isoscope::io {

struct FileRead {
  const RandomAccessFile* file = nullptr;
  std::int64_t offset = 0;
  std::size_t size = 0;
};

// A buffer, and the read that it is for.
struct ReadSlot {
  const FileRead* read = nullptr;
  std::size_t index = 0;  // of the read in the queue
  std::size_t done = 0;   // bytes read
  absl::Status status;
  std::unique_ptr<char[]> buffer;
  std::size_t capacity = 0;
};
using ReadSlots = std::vector<std::unique_ptr<ReadSlot>>;  // the oldest first; some hundred at most

// Moves the first slot out of a list that is not empty. O(n).
std::unique_ptr<ReadSlot> TakeFirst(ReadSlots* slots);

// Reads the missing bytes of a slot with pread, in calls of at most `max_transfer_bytes`. An
// exception becomes the slot's status, because threads without a caller run this.
void ReadRest(std::size_t max_transfer_bytes, ReadSlot* slot) noexcept;

// Passes reads from the queue to an engine, and ended reads back to the queue. The queue keeps room
// in both lists for every slot, so that no engine allocates.
struct ReadExchange {
  base::Mutex mutex;
  base::CondVar changed;  // the queue's callers wait for it
  ReadSlots started ABSL_GUARDED_BY(mutex);
  ReadSlots arrived ABSL_GUARDED_BY(mutex);
  bool is_stopping ABSL_GUARDED_BY(mutex) = false;
};

// Thread-compatible: the queue calls it under the exchange's lock.
class ReadEngine {
 public:
  // Waits for the reads under way. REQUIRES: the exchange is stopping; the lock is not held.
  virtual ~ReadEngine() = default;

  // Makes a thread if one more read can use it. Returns false if there is no thread and none can be
  // made. Throws nothing.
  virtual bool HasThread() = 0;
  // Tells the threads that `started` has a new read. `is_first`: the list was empty before.
  virtual void Announce(bool is_first) = 0;
  // Returns true if reads of cold files are faster when started together.
  [[nodiscard]] virtual bool takes_batches() const = 0;
};

// The largest number of threads that read: enough to keep a disk busy with merged reads.
inline constexpr std::size_t kMaxReadThreads = 8;
std::unique_ptr<ReadEngine> MakeThreadEngine(ReadExchange* exchange, std::size_t max_threads,
                                             std::size_t max_transfer_bytes);
// Returns null where the kernel, or a rule of the container, refuses io_uring.
std::unique_ptr<ReadEngine> MakeRingEngine(ReadExchange* exchange, std::size_t max_requests,
                                           std::size_t max_transfer_bytes);

}  // namespace isoscope::io

#endif  // ISOSCOPE_CORE_IO_READ_ENGINE_H_
