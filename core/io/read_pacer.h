// Decides when the reads of a queue may begin, from the buffers in use and the hits in memory. It
// has no thread and no file, so that a table of events can test it.
//
//   event      when                                            effect
//   Begin      a read takes a buffer                           one more in use
//   End        an arrival gives its buffer back                one less in use
//   RecordHit  memory had all bytes of a read                  the files are warm
//   RecordMiss memory did not                                  after kColdReads in a row: cold
//   EndBatch   reads were started together up to the bounds    the batch is what is in use now
//
// Cold files. Trying memory first is a system call, and reads that start one by one are submitted
// one by one. So an io_uring starts many together, without trying memory; the next read waits until
// a quarter of that batch is free again. One hit ends this.

#ifndef ISOSCOPE_CORE_IO_READ_PACER_H_
#define ISOSCOPE_CORE_IO_READ_PACER_H_

#include <algorithm>
#include <atomic>
#include <cstddef>

#include "core/base/units.h"

namespace isoscope::io {

// Thread-compatible, except RecordHit, RecordMiss and is_cold, which are thread-safe. All O(1).
class ReadPacer {
 public:
  // After this many reads in a row that were not in memory, the files are taken to be cold.
  static constexpr std::size_t kColdReads = 8;
  // Buffer sizes are multiples of this, so that reads of similar sizes can use the same buffers.
  static constexpr std::size_t kBufferStepBytes = 64 * static_cast<std::size_t>(base::kKiB);

  // The bounds of all buffers in use. A larger one may be in use alone. REQUIRES: max_count >= 1.
  ReadPacer(std::size_t max_bytes, std::size_t max_count)
      : max_bytes_(max_bytes), max_count_(max_count) {}

  // Returns the size of the buffer for a read.
  static std::size_t BufferBytesFor(std::size_t read_bytes) {
    return (std::max<std::size_t>(read_bytes, 1) + kBufferStepBytes - 1) / kBufferStepBytes *
           kBufferStepBytes;
  }

  // Returns true if the bounds allow one more buffer of this size.
  [[nodiscard]] bool HasRoom(std::size_t buffer_bytes) const {
    return count_ == 0 || (count_ < max_count_ && buffer_bytes <= max_bytes_ &&
                           bytes_ <= max_bytes_ - buffer_bytes);
  }
  // Returns true if a read need not wait for more of a batch, apart from room.
  [[nodiscard]] bool IsDue() const {
    return !is_cold() || batch_count_ == 0 || count_ <= batch_count_ - batch_count_ / 4;
  }
  // Returns true if no buffer is in use.
  [[nodiscard]] bool is_idle() const { return count_ == 0; }
  [[nodiscard]] bool is_cold() const {
    return misses_.load(std::memory_order_relaxed) >= kColdReads;
  }

  void Begin(std::size_t buffer_bytes) {
    ++count_;
    bytes_ += buffer_bytes;
  }
  // REQUIRES: Begin was called with this size.
  void End(std::size_t buffer_bytes) {
    --count_;
    bytes_ -= buffer_bytes;
  }
  void EndBatch() { batch_count_ = count_; }
  void RecordMiss() { misses_.fetch_add(1, std::memory_order_relaxed); }
  // Returns true if the files were cold: IsDue may be true now.
  bool RecordHit() { return misses_.exchange(0, std::memory_order_relaxed) >= kColdReads; }

 private:
  const std::size_t max_bytes_;
  const std::size_t max_count_;
  std::size_t count_ = 0;  // of buffers in use, and their bytes
  std::size_t bytes_ = 0;
  std::size_t batch_count_ = 0;          // count_ at the last EndBatch; 0: there was no batch
  std::atomic<std::size_t> misses_ = 0;  // since the last hit
};

}  // namespace isoscope::io

#endif  // ISOSCOPE_CORE_IO_READ_PACER_H_
