#include "server/frame/event_queue.h"

#include <algorithm>
#include <new>

#include "absl/time/clock.h"

#include "core/base/no_memory.h"
#include "core/base/status_macros.h"

namespace isoscope::server {

void EventQueue::Push(FrameEvent event) noexcept {
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
  // Without the mutex, which the woken thread needs at once. The queue outlives all pushes.
  if (wakes) {
    arrived_.Signal();
  }
}

void EventQueue::SetNeeded(const FrameProtocol::Awaited& needed) {
  const base::MutexLock lock(&mutex_);
  needed_ = needed;
  for (const FrameEvent& event : events_) {
    has_urgent_one_ = has_urgent_one_ || IsUrgent(event);
  }
}

bool EventQueue::is_ready() const {
  const base::MutexLock lock(&mutex_);
  return IsReady();
}

absl::StatusOr<std::deque<FrameEvent>> EventQueue::PopAll(absl::Time wake,
                                                          const base::Cancellation& cancellation) {
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
  ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());  // what has come stays, for TakeAll
  events.swap(events_);
  has_urgent_one_ = false;
  return events;
}

std::deque<FrameEvent> EventQueue::TakeAll() {
  std::deque<FrameEvent> events;
  const base::MutexLock lock(&mutex_);
  events.swap(events_);
  return events;
}

// A stream ends right after its frame is done.
bool EventQueue::IsUrgent(const FrameEvent& event) const {
  return event.ended_stage != needed_.stage && event.ended_stage != FrameStage::kDone;
}

bool EventQueue::IsReady() const {
  return has_urgent_one_ || has_lost_one_ || events_.size() >= needed_.count;
}

void QueueingListener::OnPixels(std::vector<std::string> bands) {
  std::size_t bytes = 0;
  for (const std::string& band : bands) {
    bytes += band.size();
  }
  auto hold = std::make_shared<const ReadGate::Hold>(gate_.Add(bytes));
  Push(AgentWord::kPixels, Bands{std::move(bands), std::move(hold)});
}

void QueueingListener::Push(AgentWord word, FrameEvent::Content content, absl::Status status) {
  std::optional<FrameStage> ended_stage = EndedStage(word, status);
  if (ended_stage == stage_) {
    stage_ = NextStage(stage_);
  } else {
    ended_stage.reset();
  }
  queue_->Push({{id_, word, absl::Now(), std::move(status)}, std::move(content), ended_stage});
}

}  // namespace isoscope::server
