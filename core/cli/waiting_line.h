// Shows the step that a command waits for and the time so far, if no other progress is shown.

#ifndef ISOSCOPE_CORE_CLI_WAITING_LINE_H_
#define ISOSCOPE_CORE_CLI_WAITING_LINE_H_

#include <iosfwd>
#include <string>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/time/time.h"

#include "core/base/mutex.h"

namespace isoscope::cli {

// While it lives, and from one second on, a line like "rendering   12 s" stands on the terminal,
// and is cleared afterwards. If `err` is no terminal, nothing is written. REQUIRES: no other code
// writes to `err` meanwhile.
class WaitingLine {
 public:
  // `err` must outlive it.
  WaitingLine(std::ostream* err, bool is_terminal, std::string text,
              absl::Duration delay = absl::Seconds(1));
  ~WaitingLine();
  WaitingLine(const WaitingLine&) = delete;
  WaitingLine& operator=(const WaitingLine&) = delete;

 private:
  void Run(std::ostream* err) ABSL_LOCKS_EXCLUDED(mutex_);

  const std::string text_;
  const absl::Duration delay_;
  base::Mutex mutex_;
  base::CondVar ended_;
  bool has_ended_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;  // last: it uses the others; none if there is no terminal
};

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CORE_CLI_WAITING_LINE_H_
