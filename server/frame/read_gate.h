// Bounds the pixels of a frame that have arrived and wait to be composited. An agent's next message
// is read once there is room; until then gRPC's flow control stops the agent.

#ifndef ISOSCOPE_SERVER_FRAME_READ_GATE_H_
#define ISOSCOPE_SERVER_FRAME_READ_GATE_H_

#include <cstddef>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"

#include "core/base/mutex.h"

namespace isoscope::server {

// Thread-safe. Outlives its holds.
class ReadGate {
 public:
  // Bytes that wait. The destructor subtracts them, and may call functions of WhenRoom.
  class Hold {
   public:
    Hold(Hold&& other) noexcept
        : gate_(std::exchange(other.gate_, nullptr)), bytes_(other.bytes_) {}
    Hold& operator=(Hold&&) = delete;
    ~Hold() {
      if (gate_ != nullptr) {
        gate_->Release(bytes_);
      }
    }

   private:
    friend class ReadGate;
    Hold(ReadGate* gate, std::size_t bytes) : gate_(gate), bytes_(bytes) {}

    ReadGate* gate_;
    std::size_t bytes_;
  };

  // The gate is shut while more than `max_bytes` wait. Each agent may exceed the limit by one
  // message.
  explicit ReadGate(std::size_t max_bytes) : max_bytes_(max_bytes) {}
  ReadGate(const ReadGate&) = delete;
  ReadGate& operator=(const ReadGate&) = delete;

  // Adds bytes that wait; never blocks.
  [[nodiscard]] Hold Add(std::size_t bytes) ABSL_LOCKS_EXCLUDED(mutex_);
  // Calls `read` once, as soon as the gate is open: at once, or when a hold ends, on its thread.
  void WhenRoom(std::function<void()> read) ABSL_LOCKS_EXCLUDED(mutex_);

  // Opens the gate for good: compositing has ended.
  void Open() ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  void Release(std::size_t bytes) ABSL_LOCKS_EXCLUDED(mutex_);
  [[nodiscard]] bool IsOpen() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return is_always_open_ || waiting_bytes_ <= max_bytes_;
  }

  const std::size_t max_bytes_;
  base::Mutex mutex_;
  std::size_t waiting_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  bool is_always_open_ ABSL_GUARDED_BY(mutex_) = false;
  std::vector<std::function<void()>> readers_ ABSL_GUARDED_BY(mutex_);  // one a stream at most
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_READ_GATE_H_
