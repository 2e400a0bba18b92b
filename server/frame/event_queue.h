// The events of a frame's agents, passed from their threads to the thread of the frame.
//
// The frame's thread sleeps until every part at the earliest stage may have ended it, or until
// pixels or an error arrive. So with hundreds of agents it does not wake for each event.

#ifndef ISOSCOPE_SERVER_FRAME_EVENT_QUEUE_H_
#define ISOSCOPE_SERVER_FRAME_EVENT_QUEUE_H_

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
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/no_memory.h"
#include "core/base/status_macros.h"
#include "core/frame/agent_statistics.h"
#include "core/image/pixel_mailboxes.h"
#include "core/volume/block_layout.h"
#include "server/frame/agent_link.h"
#include "server/frame/frame_protocol.h"
#include "server/frame/read_gate.h"

namespace isoscope::server {

struct RayHits {
  std::vector<volume::BlockId> hits;
  std::vector<volume::BlockId> active;
};
struct Bands {
  std::vector<std::string> bands;
  std::shared_ptr<const ReadGate::Hold> hold;  // of all bands
};

struct FrameEvent {
  using Content =
      std::variant<std::monostate, RayHits, Bands, image::DrawnPixels, frame::AgentStatistics>;

  AgentEvent said;
  Content content = {};
  // The stage that the event ends if it is the agent's next word; not set: the frame must look at
  // once.
  std::optional<PartStage> ended_stage = std::nullopt;
};

// Keeps events in order of arrival. Thread-safe.
class EventQueue {
 public:
  // Agents' threads call it, which can't handle an exception.
  void Push(FrameEvent event) noexcept ABSL_LOCKS_EXCLUDED(mutex_) {
    bool wakes = false;
    {
      const base::MutexLock lock(&mutex_);
      const bool was_ready = IsReady();
      has_urgent_one_ = has_urgent_one_ || IsUrgent(event);
      try {
        events_.push_back(std::move(event));
      } catch (const std::bad_alloc&) {
        has_lost_one_ = true;
      }
      wakes = !was_ready && IsReady();
    }
    // The mutex is free, because the woken thread needs it at once. The queue outlives all pushes.
    if (wakes) {
      arrived_.Signal();
    }
  }

  // Sets the number of events that end `stage` before the frame can go on, at least 1. Any other
  // event makes the queue ready. A needless wake-up costs as much as an event.
  void SetNeeded(const FrameProtocol::Awaited& needed) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    needed_ = needed;
    for (const FrameEvent& event : events_) {
      has_urgent_one_ = has_urgent_one_ || IsUrgent(event);
    }
  }
  [[nodiscard]] bool is_ready() const ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    return IsReady();
  }

  // Waits until the queue is ready, or until `wake`, and returns all events that have come; there
  // may be none. Returns the cancellation's error if it fires first. RESOURCE_EXHAUSTED if there
  // was no memory for an event.
  absl::StatusOr<std::deque<FrameEvent>> PopAll(base::MonotonicTime wake,
                                                const base::Cancellation& cancellation)
      ABSL_LOCKS_EXCLUDED(mutex_) {
    std::deque<FrameEvent> events;
    const base::Cancellation::Callback stop(cancellation, [this] {
      const base::MutexLock lock(&mutex_);
      arrived_.SignalAll();
    });
    const base::MutexLock lock(&mutex_);
    arrived_.AwaitUntil(&mutex_, std::min(wake, cancellation.deadline()),
                        [&]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
                          return IsReady() || cancellation.is_cancelled();
                        });
    if (has_lost_one_) {
      return base::NoMemory("an agent's message");
    }
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());  // the events stay for TakeAll
    events.swap(events_);
    has_urgent_one_ = false;
    return events;
  }
  // Returns the events that have come and were not popped.
  std::deque<FrameEvent> TakeAll() ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    return std::exchange(events_, {});
  }

 private:
  // A stream ends right after its frame is done, so that end is not urgent.
  [[nodiscard]] bool IsUrgent(const FrameEvent& event) const ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
    return event.ended_stage != needed_.stage && event.ended_stage != PartStage::kDone;
  }
  [[nodiscard]] bool IsReady() const ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
    return has_urgent_one_ || has_lost_one_ || events_.size() >= needed_.count;
  }

  mutable base::Mutex mutex_;
  base::CondVar arrived_;
  std::deque<FrameEvent> events_ ABSL_GUARDED_BY(mutex_);
  FrameProtocol::Awaited needed_ ABSL_GUARDED_BY(mutex_){1, PartStage::kSelectingOccluders};
  bool has_urgent_one_ ABSL_GUARDED_BY(mutex_) = false;
  bool has_lost_one_ ABSL_GUARDED_BY(mutex_) = false;
};

// The listener of one attempt.
class QueueingListener final : public AgentListener {
 public:
  // stage: the first stage of the attempt. Queue and gate outlive the listener.
  QueueingListener(AttemptId id, PartStage stage, EventQueue* queue, ReadGate* gate)
      : id_(id), queue_(queue), gate_(*gate), stage_(stage) {}

  void OnRayHits(std::vector<volume::BlockId> hits, std::vector<volume::BlockId> active) override {
    Push(AgentWord::kRayHits, RayHits{std::move(hits), std::move(active)});
  }
  void OnPixels(std::vector<std::string> bands) override {
    std::size_t bytes = 0;
    for (const std::string& band : bands) {
      bytes += band.size();
    }
    auto hold = std::make_shared<const ReadGate::Hold>(gate_.Add(bytes));
    Push(AgentWord::kPixels, Bands{std::move(bands), std::move(hold)});
  }
  void OnDrawnPixels(image::DrawnPixels pixels) override {
    Push(AgentWord::kPixels, std::move(pixels));
  }
  void OnOccludersDone() override { Push(AgentWord::kOccludersDone, {}); }
  void OnFrameDone(frame::AgentStatistics statistics) override {
    Push(AgentWord::kFrameDone, std::move(statistics));
  }
  void OnEnd(absl::Status status) override { Push(AgentWord::kEnd, {}, std::move(status)); }
  void WhenRoom(std::function<void()> read) override { gate_.WhenRoom(std::move(read)); }

 private:
  void Push(AgentWord word, FrameEvent::Content content, absl::Status status = absl::OkStatus()) {
    std::optional<PartStage> ended_stage = EndedStage(word, status);
    if (ended_stage == stage_) {
      stage_ = NextStage(stage_);
    } else {
      ended_stage.reset();
    }
    queue_->Push(
        {{id_, word, base::MonotonicNow(), std::move(status)}, std::move(content), ended_stage});
  }

  const AttemptId id_;
  EventQueue* const queue_;
  ReadGate& gate_;
  PartStage stage_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_EVENT_QUEUE_H_
