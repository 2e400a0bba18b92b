// The pixels of a frame that have arrived and wait to be composited.
//
// The frame's own thread composites them before it waits for events, and threads of the arena help
// if many wait. The frame's thread must take part: agents of this process wait for memory that the
// queued pixels hold, and an arena may have no spare thread; an arena of one thread never has. Each
// arrival wakes it, at a cost. Without that more images would be under way and leave the
// processor's caches, which costs more.

#ifndef ISOSCOPE_SERVER_FRAME_PIXEL_QUEUE_H_
#define ISOSCOPE_SERVER_FRAME_PIXEL_QUEUE_H_

#include <algorithm>
#include <cstddef>
#include <deque>
#include <functional>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include <oneapi/tbb/task_group.h>

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/task_arena.h"
#include "core/image/pixel_mailboxes.h"
#include "server/frame/event_queue.h"
#include "server/frame/frame_protocol.h"
#include "server/frame/read_gate.h"
#include "server/frame/reduction.h"

namespace isoscope::server {

// Only the frame's thread calls it; the queue starts its helpers itself.
class PixelQueue {
 public:
  // Calls on_damage once Finish has something to return: on any thread, with no lock held.
  // Reduction and arena outlive the queue.
  PixelQueue(Reduction* reduction, base::TaskArena* arena, std::function<void()> on_damage)
      : reduction_(*reduction), arena_(*arena), on_damage_(std::move(on_damage)) {}
  ~PixelQueue() { Abandon(); }
  PixelQueue(const PixelQueue&) = delete;
  PixelQueue& operator=(const PixelQueue&) = delete;

  void Push(AttemptId from, Bands bands) {
    is_first_ = false;
    std::vector<Arrival> arrivals;
    arrivals.reserve(bands.bands.size());
    for (std::string& band : bands.bands) {
      const std::size_t tile_count = band.size() / kFullTileBytes + 1;
      arrivals.push_back({from, std::move(band), bands.hold, tile_count});
    }
    Push(std::move(arrivals));
  }
  // The first image becomes the result; others are composited into it.
  void Push(AttemptId from, image::DrawnPixels pixels) {
    if (std::exchange(is_first_, false)) {
      reduction_.Adopt(&pixels);
      if (!reduction_.has_layers()) {
        return;
      }
    }
    std::vector<Arrival> arrivals;
    const std::size_t tile_count = TileCountOf(pixels);
    arrivals.push_back({from, std::move(pixels), nullptr, tile_count});
    Push(std::move(arrivals));
  }

  // Composites the earliest arrival on this thread, unless nothing waits.
  void CompositeOne() {
    std::optional<base::OneThreadScope> alone;
    if (arena_.shares_threads()) {
      alone.emplace();  // steps have the other threads
    }
    base::RunIn(&arena_, [this] { CompositeNext(); });
  }
  [[nodiscard]] bool empty() const ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    return arrivals_.empty();
  }

  // Returns once all valid pixels that have arrived are in the reduction. Returns a kDamaged for
  // each damaged arrival.
  std::vector<AgentEvent> Finish() ABSL_LOCKS_EXCLUDED(mutex_) {
    base::RunIn(&arena_, [&] {
      if (arena_.shares_threads()) {
        StartHelpers(HelpersToAdd());
      }
      while (CompositeNext()) {
      }
      helpers_.wait();
    });
    has_tasks_ = false;
    std::vector<AgentEvent> damages;
    const base::MutexLock lock(&mutex_);
    damages.swap(damages_);
    return damages;
  }
  // Drops the pixels whose compositing has not begun, and waits for the rest. Allocates nothing.
  // Runs in the arena, because an arena of one thread has no other thread for the tasks.
  void Abandon() noexcept ABSL_LOCKS_EXCLUDED(mutex_) {
    if (!std::exchange(has_tasks_, false)) {
      return;
    }
    while (Pop().has_value()) {
    }
    try {
      base::RunIn(&arena_, [&] { helpers_.wait(); });
    } catch (const std::bad_alloc&) {
      // A task has thrown it. All tasks are done, and the frame has failed already.
    }
  }

 private:
  // A full tile of a band has about as many bytes.
  static constexpr std::size_t kFullTileBytes = 1024;
  // One thread composites this many tiles in some hundred microseconds. Waking another thread takes
  // as long.
  static constexpr std::size_t kTilesPerHelper = 512;

  // A band, or all pixels of an agent's step.
  struct Arrival {
    AttemptId from;
    std::variant<std::string, image::DrawnPixels> pixels;
    std::shared_ptr<const ReadGate::Hold> hold;  // of bands
    std::size_t tile_count = 0;                  // about
  };

  // Calls threads of the arena to help if compositing takes the frame's own thread longer than
  // waking another one.
  void Push(std::vector<Arrival> arrivals) ABSL_LOCKS_EXCLUDED(mutex_) {
    has_tasks_ = true;
    {
      const base::MutexLock lock(&mutex_);
      for (Arrival& arrival : arrivals) {
        waiting_tiles_ += arrival.tile_count;
        arrivals_.push_back(std::move(arrival));
      }
    }
    if (arena_.shares_threads()) {
      return;  // all threads are in steps, until Finish
    }
    if (const std::size_t count = HelpersToAdd(); count > 0) {
      base::RunIn(&arena_, [&] { StartHelpers(count); });
    }
  }
  // Counts them as added.
  std::size_t HelpersToAdd() ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    const std::size_t wanted = std::min({waiting_tiles_ / kTilesPerHelper, arrivals_.size(),
                                         static_cast<std::size_t>(arena_.max_concurrency())});
    const std::size_t count = wanted - std::min(wanted, helper_count_);
    helper_count_ += count;
    return count;
  }
  void StartHelpers(std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) {
      helpers_.run([this] { Help(); });
    }
  }
  // Takes the earliest arrival, unless another thread has.
  std::optional<Arrival> Pop() ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    if (arrivals_.empty()) {
      return std::nullopt;
    }
    std::optional<Arrival> arrival(std::move(arrivals_.front()));
    arrivals_.pop_front();
    waiting_tiles_ -= arrival->tile_count;
    return arrival;
  }
  // Composites the earliest arrival; false if nothing waits. The pixels and their memory are free
  // when it returns.
  bool CompositeNext() ABSL_LOCKS_EXCLUDED(mutex_) {
    const std::optional<Arrival> arrival = Pop();
    if (!arrival.has_value()) {
      return false;
    }
    const auto* const band = std::get_if<std::string>(&arrival->pixels);
    const absl::Status status =
        band != nullptr ? reduction_.CompositeBand(*band)
                        : reduction_.CompositeDrawn(std::get<image::DrawnPixels>(arrival->pixels),
                                                    arrival->tile_count >= kTilesPerHelper);
    if (!status.ok()) {
      {
        const base::MutexLock lock(&mutex_);
        damages_.push_back(
            {arrival->from, AgentWord::kDamaged, base::MonotonicNow(),
             absl::Status(status.code(), absl::StrCat("pixels: ", status.message()))});
      }
      on_damage_();
    }
    return true;
  }
  // Composites until nothing waits.
  void Help() ABSL_LOCKS_EXCLUDED(mutex_) {
    while (CompositeNext()) {
    }
    const base::MutexLock lock(&mutex_);
    --helper_count_;
  }

  static std::size_t TileCountOf(const image::DrawnPixels& pixels) {
    std::size_t count = pixels.image.touched.Count();
    for (const image::FrameImage* layer_image : pixels.layers.LayerImages()) {
      count += layer_image->touched.Count();
    }
    return count;
  }

  Reduction& reduction_;
  base::TaskArena& arena_;
  const std::function<void()> on_damage_;
  bool is_first_ = true;  // no pixels have come yet
  mutable base::Mutex mutex_;
  std::deque<Arrival> arrivals_ ABSL_GUARDED_BY(mutex_);
  std::size_t waiting_tiles_ ABSL_GUARDED_BY(mutex_) = 0;  // of arrivals_
  std::size_t helper_count_ ABSL_GUARDED_BY(mutex_) = 0;
  std::vector<AgentEvent> damages_ ABSL_GUARDED_BY(mutex_);
  tbb::task_group helpers_;
  bool has_tasks_ = false;  // since the last wait for helpers_
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_PIXEL_QUEUE_H_
