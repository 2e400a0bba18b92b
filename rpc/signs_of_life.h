// Tells the receiver of a stream now and then that the sender works, though it has nothing to send.
// Receivers end a call that is silent for long.

#ifndef ISOSCOPE_RPC_SIGNS_OF_LIFE_H_
#define ISOSCOPE_RPC_SIGNS_OF_LIFE_H_

#include <functional>
#include <memory>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/time/time.h"
#include <grpcpp/alarm.h>

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "rpc/grpc_time.h"

namespace isoscope::rpc {

// Well below the silence that ends a call: minutes.
inline constexpr absl::Duration kSignOfLifeInterval = absl::Seconds(10);

// Whether a message carries no part of a mesh, and no measures.
inline bool IsSignOfLife(const isoscope::v1::ExportIsosurfaceResponse& message) {
  return message.positions().empty() && message.normals().empty() && message.triangles().empty() &&
         !message.has_measures();
}

// Thread-safe. Part of a call's reactor, which calls Stop in OnDone at the latest.
class SignsOfLife {
 public:
  SignsOfLife() = default;
  ~SignsOfLife() { Stop(); }
  SignsOfLife(const SignsOfLife&) = delete;
  SignsOfLife& operator=(const SignsOfLife&) = delete;

  // Calls `send` every `interval` until Stop, on gRPC's threads. It must not block, nor call back.
  // Call it once. Does nothing after Stop.
  void Start(absl::Duration interval, std::function<void()> send) {
    const base::MutexLock lock(&state_->mutex);
    if (!state_->is_stopped) {
      state_->interval = interval;
      state_->send = std::move(send);
      SetAlarm(state_);
    }
  }

  // Waits for a `send` under way; no other follows.
  void Stop() {
    // Destroyed without the lock: gRPC may wait for its callback.
    std::unique_ptr<grpc::Alarm> last;
    const base::MutexLock lock(&state_->mutex);
    state_->is_stopped = true;
    state_->send = nullptr;
    last = std::move(state_->alarm);
  }

 private:
  // Shared with an alarm that rings while the call ends.
  struct State {
    base::Mutex mutex;
    absl::Duration interval ABSL_GUARDED_BY(mutex);
    std::function<void()> send ABSL_GUARDED_BY(mutex);
    std::unique_ptr<grpc::Alarm> alarm ABSL_GUARDED_BY(mutex);
    bool is_stopped ABSL_GUARDED_BY(mutex) = false;
  };

  static void SetAlarm(const std::shared_ptr<State>& state)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(state->mutex) {
    state->alarm = std::make_unique<grpc::Alarm>();
    state->alarm->Set(base::MonotonicNow() + state->interval, [state](bool rang) {
      const base::MutexLock lock(&state->mutex);
      if (rang && !state->is_stopped) {
        state->send();
        SetAlarm(state);
      }
    });
  }

  const std::shared_ptr<State> state_ = std::make_shared<State>();
};

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_RPC_SIGNS_OF_LIFE_H_
