#include "partition-agent/begun_frames.h"

#include <algorithm>

namespace isoscope::agent {
namespace {

// The number of questions, below that of any frame.
constexpr std::int64_t kQuestion = -1;

absl::Status StopsError() {
  return absl::UnavailableError(
      "the agent stops: it finishes frames that have begun, and takes no others");
}

}  // namespace

BegunFrames::Call& BegunFrames::Call::operator=(Call&& other) noexcept {
  End();
  frames_ = std::exchange(other.frames_, nullptr);
  key_ = std::move(other.key_);
  is_question_ = other.is_question_;
  others_until_ = other.others_until_;
  return *this;
}

void BegunFrames::Call::End() {
  if (BegunFrames* const frames = std::exchange(frames_, nullptr); frames != nullptr) {
    frames->EndCall(*this);
  }
}

absl::StatusOr<BegunFrames::Call> BegunFrames::BeginFrame(const std::string& request_id,
                                                          std::int64_t frame_number) {
  const base::MutexLock lock(&mutex_);
  Forget(base::MonotonicNow());
  Key key(request_id, frame_number);
  // A question before the frame, such as the box of its cells, has begun it.
  if (is_stopping_ && !entries_.contains(key) && !entries_.contains({request_id, kQuestion})) {
    return StopsError();
  }
  return Begin(std::move(key), /*is_question=*/false);
}

absl::StatusOr<BegunFrames::Call> BegunFrames::BeginQuestion(const std::string& request_id) {
  const base::MutexLock lock(&mutex_);
  Forget(base::MonotonicNow());
  if (!is_stopping_) {
    return Begin({request_id, kQuestion}, /*is_question=*/true);
  }
  // A question of a frame begins no other frame of an interactive stream, whose id is one.
  const auto first = entries_.lower_bound({request_id, kQuestion});
  if (first == entries_.end() || first->first.first != request_id) {
    return StopsError();
  }
  return Begin(first->first, /*is_question=*/true);
}

void BegunFrames::EndFrame(const std::string& request_id, std::int64_t frame_number) {
  const base::MutexLock lock(&mutex_);
  const auto entry = entries_.find({request_id, frame_number});
  if (entry != entries_.end()) {
    entry->second.has_ended = true;  // its last call may not have ended here, although it has there
    entry->second.end = base::MonotonicTime::InfinitePast();
    changed_.SignalAll();
  }
}

absl::Status BegunFrames::CheckNotStopping() const {
  const base::MutexLock lock(&mutex_);
  return is_stopping_ ? StopsError() : absl::OkStatus();
}

std::size_t BegunFrames::Stop() {
  const base::MutexLock lock(&mutex_);
  is_stopping_ = true;
  Forget(base::MonotonicNow());
  return entries_.size();
}

void BegunFrames::AwaitEnd(base::MonotonicTime deadline) {
  const base::MutexLock lock(&mutex_);
  for (;;) {
    const base::MonotonicTime now = base::MonotonicNow();
    Forget(now);
    if (entries_.empty() || now >= deadline) {
      return;
    }
    changed_.WaitUntil(&mutex_, std::min(deadline, NextEnd()));
  }
}

BegunFrames::Call BegunFrames::Begin(Key key, bool is_question) {
  Entry& entry = entries_[key];
  ++entry.call_count;
  entry.has_ended = false;
  return {this, std::move(key), is_question};
}

void BegunFrames::EndCall(const Call& call) {
  const base::MutexLock lock(&mutex_);
  Entry& entry = entries_.find(call.key_)->second;
  --entry.call_count;
  if (!entry.has_ended) {
    entry.end = std::max(call.is_question_ ? entry.end : call.others_until_,
                         base::MonotonicNow() + after_last_call_);
  }
  if (entries_.size() > kMaxEntries) {
    const auto ends_before = [](const Entries::value_type& a, const Entries::value_type& b) {
      return (a.second.call_count == 0) != (b.second.call_count == 0) ? a.second.call_count == 0
                                                                      : a.second.end < b.second.end;
    };
    const auto first = std::min_element(entries_.begin(), entries_.end(), ends_before);
    if (first->second.call_count == 0) {
      entries_.erase(first);
    }
  }
  changed_.SignalAll();
}

void BegunFrames::Forget(base::MonotonicTime now) {
  std::erase_if(entries_, [now](const Entries::value_type& entry) {
    return entry.second.call_count == 0 && entry.second.end <= now;
  });
}

base::MonotonicTime BegunFrames::NextEnd() const {
  base::MonotonicTime next = base::MonotonicTime::InfiniteFuture();
  for (const auto& [key, entry] : entries_) {
    if (entry.call_count == 0) {
      next = std::min(next, entry.end);
    }
  }
  return next;
}

}  // namespace isoscope::agent
