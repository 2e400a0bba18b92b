// Ends a call whose client does not read. Such a call would hold a thread, or the memory of the
// answer, without limit.

#ifndef ISOSCOPE_RPC_WRITE_TIMEOUT_H_
#define ISOSCOPE_RPC_WRITE_TIMEOUT_H_

#include <cstdint>
#include <memory>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/time/time.h"
#include <grpcpp/alarm.h>
#include <grpcpp/server_context.h>

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "rpc/grpc_time.h"

namespace isoscope::rpc {

// Thread-safe. Part of a call's reactor, which calls Stop in OnDone at the latest.
//
// An alarm is destroyed with the lock held that its function takes. That can't deadlock: gRPC calls
// the function on a thread of its executor, never in ~Alarm, and ~Alarm does not wait for it.
class WriteTimeout {
 public:
  explicit WriteTimeout(grpc::CallbackServerContext* context)
      : state_(std::make_shared<State>(context)) {}
  ~WriteTimeout() { Stop(); }
  WriteTimeout(const WriteTimeout&) = delete;
  WriteTimeout& operator=(const WriteTimeout&) = delete;

  // Cancels the call unless one of the three is called again within `timeout`. Call before a write.
  void Start(absl::Duration timeout) {
    const base::MutexLock lock(&state_->mutex);
    if (state_->context == nullptr) {
      return;
    }
    const std::int64_t number = ++state_->number;
    state_->alarm = std::make_unique<grpc::Alarm>();
    state_->alarm->Set(base::MonotonicNow() + timeout, [state = state_, number](bool rang) {
      const base::MutexLock alarm_lock(&state->mutex);
      if (rang && state->context != nullptr && state->number == number) {
        state->context->TryCancel();
      }
    });
  }

  // A write is done, and the next one has not begun.
  void Pause() {
    const base::MutexLock lock(&state_->mutex);
    ++state_->number;
    state_->alarm = nullptr;
  }

  // The context is not used any more.
  void Stop() {
    const base::MutexLock lock(&state_->mutex);
    state_->context = nullptr;
    state_->alarm = nullptr;
  }

 private:
  // Shared with alarms that ring while the call ends.
  struct State {
    explicit State(grpc::CallbackServerContext* call_context) : context(call_context) {}
    base::Mutex mutex;
    grpc::CallbackServerContext* context ABSL_GUARDED_BY(mutex);
    std::int64_t number ABSL_GUARDED_BY(mutex) = 0;  // of the last write
    std::unique_ptr<grpc::Alarm> alarm ABSL_GUARDED_BY(mutex);
  };

  const std::shared_ptr<State> state_;
};

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_RPC_WRITE_TIMEOUT_H_
