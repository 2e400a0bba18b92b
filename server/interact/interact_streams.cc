#include "server/interact/interact_streams.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"

#include "core/base/error_reason.h"
#include "core/base/retry_delay.h"

namespace isoscope::server {
namespace {

absl::Status CoordinatorStops() {
  return base::WithReason(absl::UnavailableError("the coordinator stops: connect again"),
                          base::ErrorReason::kServerStops);
}

// `rest`: what follows "256 interactive streams are open".
template <typename... Rest>
absl::Status AllAreOpen(const Rest&... rest) {
  // After which one who met too many streams may try again: people close pages in minutes.
  constexpr absl::Duration kFullDelay = absl::Seconds(5);
  return base::WithRetryDelay(absl::ResourceExhaustedError(absl::StrCat(
                                  InteractStreams::kMaxStreams, " interactive streams are open",
                                  rest..., ": retry later, with back-off")),
                              kFullDelay);
}

}  // namespace

absl::Status InteractStreams::Add(const std::string& caller,
                                  const std::shared_ptr<OpenStream>& stream) {
  std::shared_ptr<OpenStream> evicted;
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
        return AllAreOpen(", ", own_count, " of them of this caller");
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
        AllAreOpen(", and this one made room for that of another caller, which has fewer"));
  }
  return absl::OkStatus();
}

void InteractStreams::Remove(const std::string& caller, const std::shared_ptr<OpenStream>& stream) {
  const base::MutexLock lock(&mutex_);
  const auto of_caller = streams_.find(caller);
  if (of_caller == streams_.end()) {
    return;
  }
  Streams& streams = of_caller->second;
  const auto found = std::find(streams.begin(), streams.end(), stream);
  if (found == streams.end()) {
    return;
  }
  streams.erase(found);
  --count_;
  if (streams.empty()) {
    streams_.erase(of_caller);
  }
}

void InteractStreams::EndAll() {
  Streams streams;
  {
    const base::MutexLock lock(&mutex_);
    is_stopping_ = true;
    for (const auto& [caller, of_caller] : streams_) {
      streams.insert(streams.end(), of_caller.begin(), of_caller.end());
    }
  }
  for (const std::shared_ptr<OpenStream>& stream : streams) {
    stream->End(CoordinatorStops());
  }
}

}  // namespace isoscope::server
