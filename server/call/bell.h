// Calls a function of a call from threads that may outlive it: those of gRPC's alarms, and of the
// watch of tokens.

#ifndef ISOSCOPE_SERVER_CALL_BELL_H_
#define ISOSCOPE_SERVER_CALL_BELL_H_

#include <functional>
#include <memory>
#include <utility>

#include "absl/base/thread_annotations.h"

#include "core/base/mutex.h"

namespace isoscope::server {

// Thread-safe. Part of a call's reactor, which calls Silence in OnDone. Others hold ropes only, for
// as long as they like: so they never own the call, whose service may be gone.
class Bell {
 public:
  Bell() = default;
  ~Bell() { Silence(); }
  Bell(const Bell&) = delete;
  Bell& operator=(const Bell&) = delete;

  // Ropes call `ring` until Silence, one at a time. Does nothing after Silence.
  void Hang(std::function<void()> ring) {
    const base::MutexLock lock(&state_->mutex);
    if (!state_->is_silent) {
      state_->ring = std::move(ring);
    }
  }
  // Returns a function that rings. It owns nothing of the call, and may outlive the bell.
  [[nodiscard]] std::function<void()> Rope() const {
    return [state = state_] {
      const base::MutexLock lock(&state->mutex);
      if (state->ring != nullptr) {
        state->ring();
      }
    };
  }
  // Waits for a ring in work; afterwards nothing rings, and the function is gone. The caller holds
  // no lock that the function takes, and is not the function.
  void Silence() {
    const base::MutexLock lock(&state_->mutex);
    state_->ring = nullptr;
    state_->is_silent = true;
  }

 private:
  struct State {
    base::Mutex mutex;
    std::function<void()> ring ABSL_GUARDED_BY(mutex);
    bool is_silent ABSL_GUARDED_BY(mutex) = false;
  };

  const std::shared_ptr<State> state_ = std::make_shared<State>();
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_CALL_BELL_H_
