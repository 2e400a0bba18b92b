// The sending half of a streaming reaction: one write in flight, a queue bounded in bytes, and an
// end that waits for the queued messages. Worker threads push, and block when the peer is slow.
// gRPC's reactions only hand over and never block.

#ifndef ISOSCOPE_RPC_WRITE_QUEUE_H_
#define ISOSCOPE_RPC_WRITE_QUEUE_H_

#include <cstddef>
#include <deque>
#include <functional>
#include <optional>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"

#include "core/base/mutex.h"

namespace isoscope::rpc {

// `Message` is movable and has ByteSizeLong(). Thread-safe.
//
// `start_write(message)` begins a write; OnWriteDone reports its end. `finish(status)` is called
// once, when Finish was called and no write is in flight; nothing follows it. Both are called with
// the queue's lock held, so they must neither block nor call back.
template <typename Message>
class WriteQueue {
 public:
  WriteQueue(std::size_t max_bytes, std::function<void(const Message*)> start_write,
             std::function<void(const absl::Status&)> finish)
      : max_bytes_(max_bytes), start_write_(std::move(start_write)), finish_(std::move(finish)) {}

  // Waits while `max_bytes` or more are queued, then queues `message`. Once the queue is closed or
  // finished, drops the message and returns false: the caller should stop working.
  bool Push(Message message) {
    base::MutexLock lock(&mutex_);
    changed_.Await(&mutex_, [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
      return closed_ || status_.has_value() || queued_bytes_ < max_bytes_;
    });
    if (closed_ || status_.has_value()) {
      return false;
    }
    queued_bytes_ += message.ByteSizeLong();
    queue_.push_back(std::move(message));
    StartNext();
    return true;
  }

  // Queues what `make` returns if nothing is on its way or waits. Else, and once the queue is
  // closed or finished, drops it. Never blocks. `make` is called with the queue's lock held.
  template <typename Make>
  void PushIfIdle(const Make& make) {
    base::MutexLock lock(&mutex_);
    if (!closed_ && !status_.has_value() && !is_writing_ && queue_.empty()) {
      Message message = make();
      queued_bytes_ += message.ByteSizeLong();
      queue_.push_back(std::move(message));
      StartNext();
    }
  }

  // Ends the write in flight. If `ok` is false, the stream is broken, and the queue closes.
  void OnWriteDone(bool ok) {
    base::MutexLock lock(&mutex_);
    is_writing_ = false;
    if (!ok) {
      DropQueued();
      closed_ = true;
    }
    changed_.SignalAll();
    StartNext();
  }

  // Drops the queued messages and wakes threads that wait in Push. Finish must still be called.
  void Close() {
    base::MutexLock lock(&mutex_);
    closed_ = true;
    DropQueued();
    changed_.SignalAll();
  }

  // Ends the stream: with OK after all queued messages were written, with an error after the write
  // in flight. Only the first call counts, unless an error follows an OK whose messages still wait.
  void Finish(const absl::Status& status) {
    base::MutexLock lock(&mutex_);
    if (status_.has_value() && (!status_->ok() || status.ok() || queue_.empty())) {
      return;
    }
    status_ = status;
    if (!status.ok()) {
      DropQueued();
    }
    changed_.SignalAll();
    StartNext();
  }

 private:
  void DropQueued() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    queue_.clear();
    queued_bytes_ = 0;
  }

  void StartNext() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (is_writing_) {
      return;
    }
    if (!queue_.empty()) {
      in_flight_ = std::move(queue_.front());
      queue_.pop_front();
      queued_bytes_ -= in_flight_.ByteSizeLong();
      is_writing_ = true;
      start_write_(&in_flight_);
    } else if (status_.has_value() && !is_finished_) {
      is_finished_ = true;
      finish_(*status_);
    }
  }

  const std::size_t max_bytes_;
  const std::function<void(const Message*)> start_write_;
  const std::function<void(const absl::Status&)> finish_;
  base::Mutex mutex_;
  base::CondVar changed_;  // room, or an end: all that Push waits for
  std::deque<Message> queue_ ABSL_GUARDED_BY(mutex_);
  std::size_t queued_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  Message in_flight_ ABSL_GUARDED_BY(mutex_);
  bool is_writing_ ABSL_GUARDED_BY(mutex_) = false;
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;
  bool is_finished_ ABSL_GUARDED_BY(mutex_) = false;
  std::optional<absl::Status> status_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_RPC_WRITE_QUEUE_H_
