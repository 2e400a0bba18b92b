// Reads with io_uring, on one thread. Its loop (Run) repeats two steps:
//
// 1. Exchange: under the queue's lock, hand over the reads that have ended and take the new ones.
// 2. SubmitAndWait: start the queued requests, wait until one has ended, take all results. After a
//    short read the missing bytes are queued again. EAGAIN falls back to pread.
//
// The ring always has a read of an eventfd under way, and Announce writes to it to wake the thread.
// When the queue stops, the reads under way are cancelled.

#include <liburing.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <exception>
#include <iterator>
#include <thread>
#include <utility>

#include <sys/eventfd.h>

#include "core/base/check.h"
#include "core/base/no_memory.h"
#include "core/io/read_engine.h"
#include "core/io/read_queue.h"

namespace isoscope::io {
namespace {

class RingEngine final : public ReadEngine {
 public:
  RingEngine(ReadExchange* exchange, std::size_t max_requests, std::size_t max_transfer_bytes)
      : exchange_(*exchange), max_transfer_bytes_(max_transfer_bytes) {
    for (ReadSlots* slots : {&fresh_, &under_way_, &ended_}) {
      slots->reserve(max_requests);
    }
    // There is room for each request, a cancellation of each, and the event.
    const auto entries = static_cast<unsigned>(2 * max_requests + 1);
    has_uring_ = event_ >= 0 && io_uring_queue_init(entries, &uring_, 0) == 0;
  }
  ~RingEngine() override {
    if (thread_.joinable()) {
      Wake();
      thread_.join();
    }
    if (has_uring_) {
      io_uring_queue_exit(&uring_);
    }
    if (event_ >= 0) {
      close(event_);
    }
  }

  // Returns true if the kernel lets this ring read and cancel.
  bool CanRead() {
    if (!has_uring_) {
      return false;
    }
    io_uring_probe* const probe = io_uring_get_probe_ring(&uring_);
    const bool can_read = probe != nullptr &&
                          io_uring_opcode_supported(probe, IORING_OP_READ) != 0 &&
                          io_uring_opcode_supported(probe, IORING_OP_ASYNC_CANCEL) != 0;
    io_uring_free_probe(probe);
    return can_read;
  }

  bool HasThread() override {
    if (!thread_.joinable()) {
      try {
        thread_ = std::thread(&RingEngine::Run, this);
      } catch (const std::exception&) {  // too many threads in the system, or no memory for one
        return false;
      }
    }
    return true;
  }
  void Announce(bool is_first) override {
    if (is_first) {
      Wake();
    }
  }
  [[nodiscard]] bool takes_batches() const override { return true; }

 private:
  void Wake() const {
    const std::uint64_t one = 1;
    ISOSCOPE_CHECK_EQ(write(event_, &one, sizeof(one)), static_cast<ssize_t>(sizeof(one)));
  }

  // The ring's thread. All below are called by it alone. Queued requests start with the next
  // SubmitAndWait.
  void Run() {
    bool is_stopping = false;
    QueueWait();
    while (!is_stopping || !under_way_.empty()) {
      SubmitAndWait(is_stopping);
      const bool was_stopping = std::exchange(is_stopping, Exchange());
      if (is_stopping && !was_stopping) {
        for (const auto& slot : under_way_) {
          io_uring_sqe* const sqe = NextEntry();
          io_uring_prep_cancel(sqe, slot.get(), 0);
          io_uring_sqe_set_data(sqe, nullptr);
        }
      }
      for (auto& slot : fresh_) {
        if (slot->read->file->descriptor() >= 0) {
          QueueRest(slot.get());
          under_way_.push_back(std::move(slot));
        } else {
          ReadRest(max_transfer_bytes_, slot.get());
          const base::MutexLock lock(&exchange_.mutex);
          exchange_.arrived.push_back(std::move(slot));
          exchange_.changed.SignalAll();
        }
      }
      fresh_.clear();
    }
  }

  // Step 1. Hands over the reads that have ended and takes those that were started. Returns true if
  // the queue is stopping.
  bool Exchange() {
    const base::MutexLock lock(&exchange_.mutex);
    if (!ended_.empty()) {
      std::move(ended_.begin(), ended_.end(), std::back_inserter(exchange_.arrived));
      ended_.clear();
      exchange_.changed.SignalAll();
    }
    if (!exchange_.is_stopping) {
      std::move(exchange_.started.begin(), exchange_.started.end(), std::back_inserter(fresh_));
      exchange_.started.clear();
    }
    return exchange_.is_stopping;
  }

  // Step 2. Starts the queued requests, waits until at least one has ended, and takes all results.
  void SubmitAndWait(bool is_stopping) {
    int result = 0;
    do {
      result = io_uring_submit_and_wait(&uring_, 1);
    } while (result == -EINTR || result == -EAGAIN || result == -EBUSY);
    ISOSCOPE_CHECK_GE(result, 0);
    unsigned head = 0;
    unsigned count = 0;
    io_uring_cqe* cqe = nullptr;
    io_uring_for_each_cqe(&uring_, head, cqe) {
      void* const data = io_uring_cqe_get_data(cqe);
      if (data == &event_count_) {
        QueueWait();
      } else if (data != nullptr &&
                 TakeResult(static_cast<ReadSlot*>(data), cqe->res, is_stopping)) {
        const auto found =
            std::find_if(under_way_.begin(), under_way_.end(),
                         [&](const auto& candidate) { return candidate.get() == data; });
        ended_.push_back(std::move(*found));
        under_way_.erase(found);
      }
      ++count;
    }
    io_uring_cq_advance(&uring_, count);
  }

  // Takes the kernel's result. Returns true if the read has ended. Otherwise it queues the rest.
  bool TakeResult(ReadSlot* slot, int result, bool is_stopping) {
    const FileRead& read = *slot->read;
    if (result > 0) {
      slot->done += static_cast<std::size_t>(result);
    } else if (result == -EAGAIN && !is_stopping) {  // the kernel can't read without blocking
      ReadRest(max_transfer_bytes_, slot);
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
    QueueRest(slot);
    return false;
  }

  void QueueWait() {
    io_uring_sqe* const sqe = NextEntry();
    io_uring_prep_read(sqe, event_, &event_count_, sizeof(event_count_), 0);
    io_uring_sqe_set_data(sqe, &event_count_);
  }
  // Queues a read of the bytes of `slot` that are still missing, at most what one call moves.
  void QueueRest(ReadSlot* slot) {
    const FileRead& read = *slot->read;
    io_uring_sqe* const sqe = NextEntry();
    io_uring_prep_read(sqe, read.file->descriptor(), slot->buffer.get() + slot->done,
                       static_cast<unsigned>(std::min(read.size - slot->done, max_transfer_bytes_)),
                       static_cast<std::uint64_t>(read.offset) + slot->done);
    io_uring_sqe_set_data(sqe, slot);
  }
  io_uring_sqe* NextEntry() {
    io_uring_sqe* sqe = io_uring_get_sqe(&uring_);
    if (sqe == nullptr) {  // many short reads continue at once
      io_uring_submit(&uring_);
      sqe = io_uring_get_sqe(&uring_);
    }
    ISOSCOPE_CHECK(sqe != nullptr);
    return sqe;
  }

  ReadExchange& exchange_;
  const std::size_t max_transfer_bytes_;
  const int event_ = eventfd(0, EFD_CLOEXEC);
  std::uint64_t event_count_ = 0;
  io_uring uring_ = {};
  bool has_uring_ = false;
  // There is room for one of each request.
  ReadSlots fresh_;      // to be queued
  ReadSlots under_way_;  // queued
  ReadSlots ended_;
  std::thread thread_;
};

}  // namespace

std::unique_ptr<ReadEngine> MakeRingEngine(ReadExchange* exchange, std::size_t max_requests,
                                           std::size_t max_transfer_bytes) {
  auto engine = std::make_unique<RingEngine>(exchange, max_requests, max_transfer_bytes);
  return engine->CanRead() ? std::move(engine) : nullptr;
}

bool IoUringIsAvailable() {
  io_uring uring = {};
  if (io_uring_queue_init(1, &uring, 0) != 0) {
    return false;
  }
  io_uring_queue_exit(&uring);
  return true;
}

}  // namespace isoscope::io
