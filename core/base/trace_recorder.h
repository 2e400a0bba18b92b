// Records when the work of one frame was done in this process, and where: spans of time, each on a
// track. A thread is a track; so is a queue, or the network.
//
//   void DrawAll(base::TraceRecorder* trace) {
//     const base::TraceScope scope(trace, "draw");
//     ...
//   }
//
// Without a trace the recorder is null. Then a scope reads no clock and takes no memory. It costs
// one branch, which is always predicted.

#ifndef ISOSCOPE_CORE_BASE_TRACE_RECORDER_H_
#define ISOSCOPE_CORE_BASE_TRACE_RECORDER_H_

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"

#include "core/base/mutex.h"

namespace isoscope::base {

using TraceClock = std::chrono::steady_clock;
using TraceTime = TraceClock::time_point;

struct RecordedSpan {
  const char* name = nullptr;
  TraceTime begin;
  TraceTime end;
};

struct RecordedTrack {
  std::string name;                 // "frame 4711", "worker 4712", "queue"
  std::vector<RecordedSpan> spans;  // by begin; of two that begin together, the longer one first
};

struct RecordedTrace {
  std::vector<RecordedTrack> tracks;  // in the order of their first spans
  std::int64_t dropped_span_count = 0;
};

// Thread-safe.
class TraceRecorder {
 public:
  // A span takes 24 bytes. A frame of 10 000 blocks on an agent has some thousand.
  static constexpr std::size_t kMaxSpans = std::size_t{1} << 15;

  explicit TraceRecorder(std::size_t max_spans = kMaxSpans) : max_spans_(max_spans) {}
  TraceRecorder(const TraceRecorder&) = delete;
  TraceRecorder& operator=(const TraceRecorder&) = delete;

  // Adds a span to the track of the calling thread; drops and counts it if there are too many, or
  // no memory for it.
  // `name` lives as long as the process.
  void Add(const char* name, TraceTime begin, TraceTime end) ABSL_LOCKS_EXCLUDED(mutex_);
  // The same for a track that is no thread. `track` lives as long as the process. Callers make sure
  // that the spans of a track nest.
  void AddTo(const char* track, const char* name, TraceTime begin, TraceTime end)
      ABSL_LOCKS_EXCLUDED(mutex_);
  // Names the track of the calling thread; the default is "worker". `name` lives as long as the
  // process.
  void NameThisThread(const char* name) ABSL_LOCKS_EXCLUDED(mutex_);

  // Returns all spans so far.
  [[nodiscard]] RecordedTrace Get() const ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  struct Track {
    const char* name = nullptr;
    std::int64_t thread_id = 0;  // 0: no thread
    std::vector<RecordedSpan> spans;
  };

  // These may throw std::bad_alloc, and change nothing then.
  Track& ThreadTrack() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  Track& QueueTrack(const char* name) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Append(Track* track, RecordedSpan span) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const std::size_t max_spans_;
  mutable Mutex mutex_;
  std::vector<Track> tracks_ ABSL_GUARDED_BY(mutex_);  // few
  std::size_t span_count_ ABSL_GUARDED_BY(mutex_) = 0;
  std::int64_t dropped_span_count_ ABSL_GUARDED_BY(mutex_) = 0;
};

// Records its own life as a span of the thread that makes and destroys it. Thread-compatible.
class TraceScope {
 public:
  // `recorder` may be null, and outlives the scope; `name` lives as long as the process.
  TraceScope(TraceRecorder* recorder, const char* name) : recorder_(recorder), name_(name) {
    if (recorder_ != nullptr) {
      begin_ = TraceClock::now();
    }
  }
  ~TraceScope() { End(); }
  TraceScope(const TraceScope&) = delete;
  TraceScope& operator=(const TraceScope&) = delete;

  // Ends the span before the scope does.
  void End() {
    if (recorder_ != nullptr) {
      std::exchange(recorder_, nullptr)->Add(name_, begin_, TraceClock::now());
    }
  }

 private:
  TraceRecorder* recorder_;
  const char* const name_;
  TraceTime begin_{};
};

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_TRACE_RECORDER_H_
