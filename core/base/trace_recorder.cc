#include "core/base/trace_recorder.h"

#include <unistd.h>

#include <algorithm>
#include <new>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

namespace isoscope::base {
namespace {

std::int64_t ThreadId() {
  thread_local const std::int64_t id = ::gettid();
  return id;
}

}  // namespace

TraceRecorder::Track& TraceRecorder::ThreadTrack() {
  const std::int64_t id = ThreadId();
  for (Track& track : tracks_) {
    if (track.thread_id == id) {
      return track;
    }
  }
  return tracks_.emplace_back(Track{.name = "worker", .thread_id = id, .spans = {}});
}

TraceRecorder::Track& TraceRecorder::QueueTrack(const char* name) {
  for (Track& track : tracks_) {
    if (track.thread_id == 0 && absl::string_view(track.name) == name) {
      return track;
    }
  }
  return tracks_.emplace_back(Track{.name = name, .thread_id = 0, .spans = {}});
}

void TraceRecorder::Append(Track* track, RecordedSpan span) {
  if (span_count_ >= max_spans_) {
    ++dropped_span_count_;
    return;
  }
  track->spans.push_back(span);
  ++span_count_;
}

// Scopes add their spans in destructors, which may not throw.
void TraceRecorder::Add(const char* name, TraceTime begin, TraceTime end) {
  const MutexLock lock(&mutex_);
  try {
    Append(&ThreadTrack(), {name, begin, end});
  } catch (const std::bad_alloc&) {
    ++dropped_span_count_;
  }
}

void TraceRecorder::AddTo(const char* track_name, const char* name, TraceTime begin,
                          TraceTime end) {
  const MutexLock lock(&mutex_);
  try {
    Append(&QueueTrack(track_name), {name, begin, end});
  } catch (const std::bad_alloc&) {
    ++dropped_span_count_;
  }
}

void TraceRecorder::NameThisThread(const char* name) {
  const MutexLock lock(&mutex_);
  try {
    ThreadTrack().name = name;
  } catch (const std::bad_alloc&) {
    // The track keeps the name that it gets with its first span.
  }
}

RecordedTrace TraceRecorder::Get() const {
  RecordedTrace trace;
  {
    const MutexLock lock(&mutex_);
    trace.dropped_span_count = dropped_span_count_;
    for (const Track& track : tracks_) {
      if (!track.spans.empty()) {
        trace.tracks.push_back(
            {track.thread_id == 0 ? track.name : absl::StrCat(track.name, " ", track.thread_id),
             track.spans});
      }
    }
  }
  for (RecordedTrack& track : trace.tracks) {
    // Spans were added when they ended.
    std::stable_sort(track.spans.begin(), track.spans.end(),
                     [](const RecordedSpan& a, const RecordedSpan& b) {
                       return a.begin != b.begin ? a.begin < b.begin : a.end > b.end;
                     });
  }
  return trace;
}

}  // namespace isoscope::base
