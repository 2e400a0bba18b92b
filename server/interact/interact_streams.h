// The interactive streams that are open. One caller (Caller::HostKey) may have all of them until
// another asks for one. Then its newest ends for a caller that has at least two fewer. No gRPC.

#ifndef ISOSCOPE_SERVER_INTERACT_INTERACT_STREAMS_H_
#define ISOSCOPE_SERVER_INTERACT_INTERACT_STREAMS_H_

#include <algorithm>
#include <cstddef>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/time/time.h"

#include "core/base/error_reason.h"
#include "core/base/mutex.h"
#include "core/base/retry_delay.h"
#include "server/call/call_metrics.h"

namespace isoscope::server {

// Thread-safe. `Stream` is thread-safe too. It has End(status), and CutOff(reason, status) for a
// stream that its client still wants. Both are called without a lock.
template <typename Stream>
class InteractStreams {
 public:
  static constexpr std::size_t kMaxStreams = 256;

  // RESOURCE_EXHAUSTED if there are too many streams, UNAVAILABLE if the server stops. May end
  // another caller's stream to make room.
  absl::Status Add(const std::string& caller, const std::shared_ptr<Stream>& stream)
      ABSL_LOCKS_EXCLUDED(mutex_) {
    std::shared_ptr<Stream> evicted;
    {
      const base::MutexLock lock(&mutex_);
      if (is_stopping_) {
        return CoordinatorStops();
      }
      if (count_ >= kMaxStreams) {
        const auto own = streams_.find(caller);
        const std::size_t own_count = own == streams_.end() ? 0 : own->second.size();
        Streams& most =
            std::max_element(streams_.begin(), streams_.end(), [](const auto& a, const auto& b) {
              return a.second.size() < b.second.size();
            })->second;
        if (most.size() < own_count + 2) {
          return AllAreOpen(absl::StrCat(own_count, " of them of this caller"));
        }
        evicted = most.back();
        most.pop_back();
        --count_;
      }
      streams_[caller].push_back(stream);
      ++count_;
    }
    if (evicted != nullptr) {
      evicted->CutOff(
          CutReason::kMadeRoom,
          AllAreOpen("and this one made room for that of another caller, which has fewer"));
    }
    return absl::OkStatus();
  }

  // No effect on a stream that was cut off or never added.
  void Remove(const std::string& caller, const std::shared_ptr<Stream>& stream)
      ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    const auto of_caller = streams_.find(caller);
    if (of_caller == streams_.end()) {
      return;
    }
    count_ -= std::erase(of_caller->second, stream);
    if (of_caller->second.empty()) {
      streams_.erase(of_caller);
    }
  }

  // Ends all streams with UNAVAILABLE, present and future ones.
  void EndAll() ABSL_LOCKS_EXCLUDED(mutex_) {
    Streams streams;
    {
      const base::MutexLock lock(&mutex_);
      is_stopping_ = true;
      for (const auto& [caller, of_caller] : streams_) {
        streams.insert(streams.end(), of_caller.begin(), of_caller.end());
      }
    }
    for (const std::shared_ptr<Stream>& stream : streams) {
      stream->End(CoordinatorStops());
    }
  }

 private:
  using Streams = std::vector<std::shared_ptr<Stream>>;

  static absl::Status CoordinatorStops() {
    return base::WithReason(absl::UnavailableError("the coordinator stops: connect again"),
                            base::ErrorReason::kServerStops);
  }
  static absl::Status AllAreOpen(const std::string& why) {
    // Users keep a page open for minutes, so faster retries gain nothing.
    constexpr absl::Duration kFullDelay = absl::Seconds(5);
    return base::WithRetryDelay(
        absl::ResourceExhaustedError(absl::StrCat(kMaxStreams, " interactive streams are open, ",
                                                  why, ": retry later, with back-off")),
        kFullDelay);
  }

  base::Mutex mutex_;
  // The streams of each caller, in the order of arrival. No list is empty.
  std::map<std::string, Streams> streams_ ABSL_GUARDED_BY(mutex_);
  std::size_t count_ ABSL_GUARDED_BY(mutex_) = 0;
  bool is_stopping_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_INTERACT_INTERACT_STREAMS_H_
