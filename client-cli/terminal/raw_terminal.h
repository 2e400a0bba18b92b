// A terminal in raw mode: it delivers each key when it is pressed, without echo. Its old settings
// are restored in all cases.

#ifndef ISOSCOPE_CLIENT_CLI_TERMINAL_RAW_TERMINAL_H_
#define ISOSCOPE_CLIENT_CLI_TERMINAL_RAW_TERMINAL_H_

#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

namespace isoscope::cli {

// Line editing and echo are off while it lives; Ctrl-C and Ctrl-Z still send their signals. At most
// one in a process. Thread-compatible.
class RawTerminal {
 public:
  // Writes `enter`, and `leave` (at most 256 bytes) at the end: when it is destroyed, when a fatal
  // signal comes, or by RestoreTerminal. `fd` stays the caller's. FAILED_PRECONDITION if it is no
  // terminal.
  static absl::StatusOr<std::unique_ptr<RawTerminal>> Enter(int fd, absl::string_view enter,
                                                            absl::string_view leave);
  ~RawTerminal();
  RawTerminal(const RawTerminal&) = delete;
  RawTerminal& operator=(const RawTerminal&) = delete;

  // Restores the terminal, stops the process as Ctrl-Z does, and takes the terminal again when the
  // process continues.
  absl::Status Suspend();

 private:
  RawTerminal(int fd, absl::string_view enter, absl::string_view leave);
  absl::Status Take();

  const int fd_;
  const std::string enter_;
  const std::string leave_;
};

// Restores the settings of a terminal that RawTerminal has taken, if there is one. May be called in
// a signal handler, and from any thread before _exit.
void RestoreTerminal();

// Writes all of `bytes`; blocks while the terminal takes none. UNAVAILABLE with the reason.
absl::Status WriteToTerminal(int fd, absl::string_view bytes);

// Reads the bytes that arrive within `timeout`, up to some hundred; "" if none do. UNAVAILABLE once
// the terminal is gone.
absl::StatusOr<std::string> ReadFromTerminal(int fd, absl::Duration timeout);

// Turns signals into wake-ups while it lives: changes of the window's size, and Ctrl-Z, which does
// not stop the process then. At most one in a process. Thread-safe.
class TerminalSignals {
 public:
  TerminalSignals();
  ~TerminalSignals();
  TerminalSignals(const TerminalSignals&) = delete;
  TerminalSignals& operator=(const TerminalSignals&) = delete;

  struct Pending {
    bool is_resized = false;
    bool is_suspended = false;
  };
  // The signals since the last call.
  static Pending Take();

  // Readable after a signal or Wake, until Take.
  static int wake_fd();
  // Makes wake_fd readable.
  static void Wake();
};

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_TERMINAL_RAW_TERMINAL_H_
