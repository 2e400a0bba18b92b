// A terminal for programs under test: what they write is kept, and keys are pressed by the test.

#ifndef ISOSCOPE_TESTS_SUPPORT_PSEUDO_TERMINAL_H_
#define ISOSCOPE_TESTS_SUPPORT_PSEUDO_TERMINAL_H_

#include <termios.h>

#include <functional>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include <sys/types.h>

namespace isoscope::testing {

struct PseudoTerminalSize {
  int columns = 80;
  int rows = 24;
  int width_px = 0;
  int height_px = 0;
};

// Thread-compatible.
class PseudoTerminal {
 public:
  // Aborts if the system has none.
  explicit PseudoTerminal(const PseudoTerminalSize& size);
  // Ends the program, if one runs.
  ~PseudoTerminal();
  PseudoTerminal(const PseudoTerminal&) = delete;
  PseudoTerminal& operator=(const PseudoTerminal&) = delete;

  // The end that programs have. Open as long as this lives, so that its settings can be read.
  [[nodiscard]] int program_fd() const { return program_fd_; }

  // Starts a program on it, as a shell does: in a session of its own, with all three standard
  // streams on the terminal. `environment` replaces the test's, "NAME=VALUE" each.
  void Start(const std::vector<std::string>& argv, const std::vector<std::string>& environment);
  [[nodiscard]] pid_t pid() const { return pid_; }

  void Press(absl::string_view keys) const;
  // Tells the program, as window systems do.
  void Resize(const PseudoTerminalSize& size) const;
  [[nodiscard]] termios settings() const;

  // Reads until `is_done` says so of all bytes since Start or the last Forget. False if it does not
  // within two minutes.
  bool ReadUntil(const std::function<bool(const std::string& bytes)>& is_done);
  bool ReadUntilText(absl::string_view text);
  [[nodiscard]] const std::string& bytes() const { return bytes_; }
  void Forget() { bytes_.clear(); }

  // Reads on until the program ends, and returns its exit code; 128 + the signal that ended it; -1
  // if it goes on for two minutes.
  int Wait();

 private:
  // False if nothing came within `timeout`, or ever will.
  bool ReadSome(absl::Duration timeout);

  int terminal_fd_ = -1;
  int program_fd_ = -1;
  pid_t pid_ = -1;
  std::string bytes_;
};

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_PSEUDO_TERMINAL_H_
