// Ends a call whose server sends nothing: a blocking read of a call without a deadline would wait
// for ever.

#ifndef ISOSCOPE_RPC_READ_TIMEOUT_H_
#define ISOSCOPE_RPC_READ_TIMEOUT_H_

#include <memory>

#include "absl/base/thread_annotations.h"
#include "absl/time/time.h"
#include <grpcpp/alarm.h>
#include <grpcpp/client_context.h>

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "rpc/grpc_time.h"

namespace isoscope::rpc {

// Guards one read:
//
//   rpc::ReadTimeout timeout(&context, absl::Minutes(5));
//   const bool has_message = reader->Read(&message);
//   if (timeout.Stop()) {
//     // The server was silent, and the call is cancelled.
//   }
//
// For one thread. The context outlives it.
class ReadTimeout {
 public:
  // Cancels the call unless Stop is called within `timeout`.
  ReadTimeout(grpc::ClientContext* context, absl::Duration timeout)
      : state_(std::make_shared<State>(context)) {
    alarm_.Set(base::MonotonicNow() + timeout, [state = state_](bool rang) {
      const base::MutexLock lock(&state->mutex);
      if (rang && state->context != nullptr) {
        state->has_rung = true;
        state->context->TryCancel();
      }
    });
  }
  ~ReadTimeout() { Stop(); }
  ReadTimeout(const ReadTimeout&) = delete;
  ReadTimeout& operator=(const ReadTimeout&) = delete;

  // Returns true if the time had passed. The context is not used any more.
  bool Stop() {
    bool has_rung = false;
    {
      const base::MutexLock lock(&state_->mutex);
      state_->context = nullptr;
      has_rung = state_->has_rung;
    }
    alarm_.Cancel();
    return has_rung;
  }

 private:
  // Shared with an alarm that rings while the read ends.
  struct State {
    explicit State(grpc::ClientContext* call_context) : context(call_context) {}
    base::Mutex mutex;
    grpc::ClientContext* context ABSL_GUARDED_BY(mutex);
    bool has_rung ABSL_GUARDED_BY(mutex) = false;
  };

  const std::shared_ptr<State> state_;
  grpc::Alarm alarm_;
};

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_RPC_READ_TIMEOUT_H_
