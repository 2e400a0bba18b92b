// The pixels of a frame that have arrived and wait to be composited.
//
// The frame's own thread takes them before it waits for events, and threads of the arena help when
// much lies there. Agents of this process wait for memory that the queued pixels hold, and an arena
// may have no thread to spare: one of one thread never has. So without the frame's thread nobody
// would go on. Each arrival wakes it, though that costs: with more images under way they leave the
// processor's caches, which costs more.

#ifndef ISOSCOPE_SERVER_FRAME_PIXEL_QUEUE_H_
#define ISOSCOPE_SERVER_FRAME_PIXEL_QUEUE_H_

#include <cstddef>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "absl/base/thread_annotations.h"
#include <oneapi/tbb/task_arena.h>
#include <oneapi/tbb/task_group.h>

#include "core/base/mutex.h"
#include "core/image/pixel_mailboxes.h"
#include "server/frame/event_queue.h"
#include "server/frame/frame_protocol.h"
#include "server/frame/read_gate.h"
#include "server/frame/reduction.h"

namespace isoscope::server {

// The frame's thread calls it; helpers are its own.
class PixelQueue {
 public:
  // Calls on_damage once there is something for Finish to return: any thread, no lock is held.
  // Reduction and arena outlive the queue.
  PixelQueue(Reduction* reduction, tbb::task_arena* arena, std::function<void()> on_damage)
      : reduction_(*reduction), arena_(*arena), on_damage_(std::move(on_damage)) {}
  ~PixelQueue() { Abandon(); }
  PixelQueue(const PixelQueue&) = delete;
  PixelQueue& operator=(const PixelQueue&) = delete;

  void Push(AttemptId from, Bands bands);
  // REQUIRES: Reduction::CheckSize.
  void Push(AttemptId from, image::DrawnPixels pixels);

  // Composites on this thread what arrived first, unless nothing waits.
  void CompositeOne() {
    arena_.execute([this] { CompositeNext(); });
  }
  [[nodiscard]] bool empty() const ABSL_LOCKS_EXCLUDED(mutex_);

  // Returns once all that has arrived is in the reduction, but for what was damaged: these
  // kDamaged.
  std::vector<AgentEvent> Finish() ABSL_LOCKS_EXCLUDED(mutex_);
  // Drops the pixels that nobody has begun to composite, and waits for the rest. Allocates nothing.
  void Abandon() noexcept ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  // A band, or all of an agent's step.
  struct Arrival {
    AttemptId from;
    std::variant<std::string, image::DrawnPixels> pixels;
    std::shared_ptr<const ReadGate::Hold> hold;  // of bands
    std::size_t tile_count = 0;                  // about
  };

  void Push(std::vector<Arrival> arrivals) ABSL_LOCKS_EXCLUDED(mutex_);
  std::optional<Arrival> Pop() ABSL_LOCKS_EXCLUDED(mutex_);
  bool CompositeNext() ABSL_LOCKS_EXCLUDED(mutex_);
  void Help() ABSL_LOCKS_EXCLUDED(mutex_);

  Reduction& reduction_;
  tbb::task_arena& arena_;
  const std::function<void()> on_damage_;
  bool is_first_ = true;  // no pixels have come yet
  mutable base::Mutex mutex_;
  std::deque<Arrival> arrivals_ ABSL_GUARDED_BY(mutex_);
  std::size_t waiting_tiles_ ABSL_GUARDED_BY(mutex_) = 0;  // of arrivals_
  std::size_t helper_count_ ABSL_GUARDED_BY(mutex_) = 0;
  std::vector<AgentEvent> damages_ ABSL_GUARDED_BY(mutex_);
  tbb::task_group helpers_;
  bool has_tasks_ = false;  // since helpers_ was waited for
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_PIXEL_QUEUE_H_
