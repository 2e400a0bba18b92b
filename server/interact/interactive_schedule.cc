// The rules, in the order in which Next applies them:
//
// 1. Cancel. Parts of an exact frame (a view that refines) are cancelled as soon as another picture is
//    wanted. Else: A frame in work is cancelled if its state was replaced, or if it is a moving frame of
//    a view at rest. But only while less than half of its expected time has passed, and never two
//    in a row, so that a steady drag still shows frames. Quick moving frames stay
//    (kWorthCancelling).
// 2. Pause. After an error nothing begins for a while (kErrorPause).
// 3. Exact. A view at rest gets its exact frame, once, when nothing is in work. It waits while an
//    earlier exact frame waits for the network, or two were sent and not shown (kExactCredits).
// 4. Moving. A view in motion gets a frame of its newest state, once the frame before is drawn, and
//    while credits allow.
//
//   state 1   moving 1: drawn, encoded, sent ..... shown
//      state 2, 3     moving 3: drawn, encoded, sent ..... shown        (2 was never begun)
//                                         120 ms after 3:  exact 3 ............ sent

#include "server/interact/interactive_schedule.h"

#include <algorithm>

#include "core/base/monotonic_time.h"

namespace isoscope::server {
namespace {

// A running mean that follows within a few frames.
void Blend(absl::Duration value, std::optional<absl::Duration>* mean) {
  *mean = mean->has_value() ? (**mean * 3 + value) / 4 : value;
}

}  // namespace

void InteractiveSchedule::OnState(std::int64_t sequence, bool is_at_rest, base::MonotonicTime now,
                                  bool refines) {
  newest_ = sequence;
  newest_time_ = now;
  newest_rests_ = is_at_rest;
  newest_refines_ = refines;
}

void InteractiveSchedule::OnSamePicture(std::int64_t sequence, bool is_at_rest) {
  for (auto& [number, work] : in_work_) {
    work.sequence = work.sequence == newest_ ? sequence : work.sequence;
  }
  moving_started_ = moving_started_ == newest_ ? sequence : moving_started_;
  exact_started_ = exact_started_ == newest_ ? sequence : exact_started_;
  newest_ = sequence;
  newest_rests_ = newest_rests_ || is_at_rest;
}

void InteractiveSchedule::OnDrawn(std::int64_t work) {
  const auto it = in_work_.find(work);
  if (it != in_work_.end()) {
    it->second.is_drawn = true;
  }
}

void InteractiveSchedule::OnWorkEnded(std::int64_t work, bool has_answer, base::MonotonicTime now) {
  const auto it = in_work_.find(work);
  if (it == in_work_.end()) {
    return;
  }
  cancelled_last_ = it->second.is_cancelled && !it->second.is_part;
  if (!it->second.is_cancelled && !it->second.is_part) {
    Blend(now - it->second.start, it->second.is_exact ? &expected_exact_ : &expected_moving_);
  }
  waiting_count_ += has_answer ? 1 : 0;
  waiting_exact_count_ += has_answer && it->second.is_exact ? 1 : 0;
  in_work_.erase(it);
}

void InteractiveSchedule::OnSent(std::int64_t frame_number, base::MonotonicTime now, bool is_exact,
                                 bool is_part) {
  OnDropped(is_exact);
  sent_.emplace(frame_number, Sent{.time = now, .is_exact = is_exact, .is_part = is_part});
  sent_part_count_ += is_part ? 1 : 0;
}

void InteractiveSchedule::OnDropped(bool is_exact) {
  --waiting_count_;
  waiting_exact_count_ -= is_exact ? 1 : 0;
}

std::optional<absl::Duration> InteractiveSchedule::OnShown(std::int64_t frame_number,
                                                           base::MonotonicTime now) {
  for (std::map<std::int64_t, Sent>* frames : {&sent_, &overdue_}) {
    const auto it = frames->find(frame_number);
    if (it != frames->end()) {
      const absl::Duration delay = now - it->second.time;
      sent_part_count_ -= frames == &sent_ && it->second.is_part ? 1 : 0;
      frames->erase(it);
      return delay;
    }
  }
  return std::nullopt;
}

void InteractiveSchedule::SetCredits(int credits) {
  credits_ = std::clamp(credits, kMinCredits, kMaxCredits);
}

std::vector<std::int64_t> InteractiveSchedule::Expire(base::MonotonicTime now) {
  std::vector<std::int64_t> expired;
  for (auto it = sent_.begin(); it != sent_.end();) {
    if (now - it->second.time < kShownTimeout) {
      ++it;
      continue;
    }
    expired.push_back(it->first);
    overdue_.insert(*it);
    sent_part_count_ -= it->second.is_part ? 1 : 0;
    it = sent_.erase(it);
  }
  while (overdue_.size() > kMaxOverdue) {
    overdue_.erase(overdue_.begin());
  }
  return expired;
}

bool InteractiveSchedule::MayDraw() const {
  return static_cast<int>(in_work_.size()) < kMaxInWork &&
         std::all_of(in_work_.begin(), in_work_.end(), [](const auto& work) {
           return work.second.is_drawn || work.second.is_cancelled;
         });
}

bool InteractiveSchedule::MayBeginExact() const {
  const auto unshown = std::count_if(sent_.begin(), sent_.end(),
                                     [](const auto& sent) { return sent.second.is_exact; });
  return in_work_.empty() && waiting_exact_count_ == 0 &&
         unshown < (newest_refines_ ? kPartCredits : kExactCredits);
}

base::MonotonicTime InteractiveSchedule::NextExpiry() const {
  base::MonotonicTime next = base::MonotonicTime::InfiniteFuture();
  for (const auto& [number, sent] : sent_) {
    next = std::min(next, sent.time + kShownTimeout);
  }
  return next;
}

bool InteractiveSchedule::MayCancel(const Work& work, base::MonotonicTime now) const {
  const std::optional<absl::Duration>& expected =
      work.is_exact ? expected_exact_ : expected_moving_;
  return !work.is_cancelled && !work.is_drawn && !cancelled_last_ && expected.has_value() &&
         (work.is_exact || *expected >= kWorthCancelling) && now - work.start < *expected / 2;
}

FrameStart InteractiveSchedule::Begin(bool is_exact, base::MonotonicTime now) {
  moving_started_ = newest_;
  if (is_exact) {
    exact_started_ = newest_;
  }
  const std::int64_t work = next_work_++;
  in_work_[work] = {.sequence = newest_,
                    .is_exact = is_exact,
                    .is_part = is_exact && newest_refines_,
                    .start = now};
  return {.work = work, .sequence = newest_, .is_exact = is_exact};
}

InteractiveSchedule::Step InteractiveSchedule::Next(base::MonotonicTime now) {
  Step step;
  step.overdue = Expire(now);
  if (newest_ == 0) {
    return step;
  }
  const bool rests = newest_rests_ || now - newest_time_ >= kRestDelay;
  for (auto& [number, work] : in_work_) {
    const bool is_stale = work.sequence != newest_ || (rests && !work.is_exact);
    const bool other_is_cancelled = std::any_of(
        in_work_.begin(), in_work_.end(), [](const auto& w) { return w.second.is_cancelled; });
    const bool may_cancel =
        work.is_part ? !work.is_cancelled : !other_is_cancelled && MayCancel(work, now);
    if (is_stale && may_cancel) {
      work.is_cancelled = true;
      step.cancel.push_back(number);
    }
  }
  if (now < pause_end_) {
    step.wake = pause_end_;
    return step;
  }
  if (rests) {
    if (exact_started_ == newest_) {
      return step;
    }
    if (MayBeginExact()) {
      step.start = Begin(/*is_exact=*/true, now);
    } else {
      step.wake = NextExpiry();  // unless a frame in work ends before, and asks again
    }
    return step;
  }
  step.wake = newest_time_ + kRestDelay;
  if (moving_started_ != newest_ && MayDraw()) {
    if (under_way_count() < credits_) {
      step.start = Begin(/*is_exact=*/false, now);
    } else {
      step.wake = std::min(step.wake, NextExpiry());
    }
  }
  return step;
}

}  // namespace isoscope::server
