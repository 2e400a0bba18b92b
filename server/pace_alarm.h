// Rings when the pace of an export's client must be judged (server/admission/export_pace.h).

#ifndef ISOSCOPE_SERVER_PACE_ALARM_H_
#define ISOSCOPE_SERVER_PACE_ALARM_H_

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <utility>

#include "absl/base/thread_annotations.h"
#include <grpcpp/alarm.h>

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "rpc/grpc_time.h"
#include "server/admission/export_pace.h"
#include "server/call/bell.h"

namespace isoscope::server {

// Thread-safe. Part of a call's reactor, which calls Stop in OnDone. gRPC's threads keep a callback
// for a while after its alarm: so a callback has a rope of the bell only.
class PaceAlarm {
 public:
  // Judges from now on. `ring` is called on gRPC's threads until Stop, and then calls Judge.
  void Start(const ExportLimits& limits, std::function<void()> ring) ABSL_LOCKS_EXCLUDED(mutex_) {
    bell_.Hang(std::move(ring));
    const base::MutexLock lock(&mutex_);
    if (!is_stopped_) {
      pace_.emplace(limits, base::MonotonicNow());
      SetAlarm();
    }
  }
  void OnWriteBegun(std::size_t bytes) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    in_flight_bytes_ = bytes;
    if (pace_.has_value()) {
      pace_->OnWriteBegun(base::MonotonicNow());
    }
  }
  void OnWriteDone() ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    if (pace_.has_value()) {
      pace_->OnWriteDone(in_flight_bytes_, base::MonotonicNow());
    }
  }
  // Sets the next alarm if the export goes on, as it does after Stop.
  ExportPace::Verdict Judge() ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    if (is_stopped_) {
      return ExportPace::Verdict::kGoesOn;
    }
    const ExportPace::Verdict verdict = pace_->Judge(base::MonotonicNow());
    if (verdict == ExportPace::Verdict::kGoesOn) {
      SetAlarm();
    }
    return verdict;
  }
  // Waits for a `ring` in work; afterwards nothing rings, and the function is gone. The caller holds
  // no lock that `ring` takes.
  void Stop() ABSL_LOCKS_EXCLUDED(mutex_) {
    bell_.Silence();
    const base::MutexLock lock(&mutex_);
    is_stopped_ = true;
    alarm_.reset();
  }

 private:
  void SetAlarm() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    alarm_ = std::make_unique<grpc::Alarm>();
    alarm_->Set(pace_->NextJudgement(base::MonotonicNow()), [rope = bell_.Rope()](bool rang) {
      if (rang) {  // else maybe within Stop
        rope();
      }
    });
  }

  base::Mutex mutex_;
  std::optional<ExportPace> pace_ ABSL_GUARDED_BY(mutex_);  // none: before Start
  Bell bell_;                                               // rings without mutex_
  std::size_t in_flight_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  std::unique_ptr<grpc::Alarm> alarm_ ABSL_GUARDED_BY(mutex_);
  bool is_stopped_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_PACE_ALARM_H_
