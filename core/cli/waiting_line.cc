#include "core/cli/waiting_line.h"

#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/monotonic_time.h"
#include "core/cli/format.h"
#include "core/cli/progress_line.h"

namespace isoscope::cli {

WaitingLine::WaitingLine(std::ostream* err, bool is_terminal, std::string text,
                         absl::Duration delay)
    : text_(std::move(text)), delay_(delay) {
  if (is_terminal) {
    thread_ = std::thread([this, err] { Run(err); });
  }
}

WaitingLine::~WaitingLine() {
  {
    const base::MutexLock lock(&mutex_);
    has_ended_ = true;
    ended_.SignalAll();
  }
  if (thread_.joinable()) {
    thread_.join();
  }
}

void WaitingLine::Run(std::ostream* err) {
  const base::MonotonicTime start = base::MonotonicNow();
  ProgressLine line(err, /*is_terminal=*/true);
  const base::MutexLock lock(&mutex_);
  base::MonotonicTime next = start + delay_;
  while (!ended_.AwaitUntil(&mutex_, next,
                            [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return has_ended_; })) {
    line.UpdateNow(absl::StrCat(text_, "   ", FormatElapsed(base::MonotonicNow() - start)));
    next = base::MonotonicNow() + absl::Seconds(1);
  }
}

}  // namespace isoscope::cli
