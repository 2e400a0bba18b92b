// Programs as users run them: other processes, with what they print kept for the test.

#ifndef ISOSCOPE_TESTS_SUPPORT_PROCESS_H_
#define ISOSCOPE_TESTS_SUPPORT_PROCESS_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include <sys/types.h>

#include "tests/support/temp_dir.h"

namespace isoscope::testing {

// For anything that must happen sooner or later, on a slow machine under sanitizers too.
inline constexpr absl::Duration kPatience = absl::Seconds(120);

// Returns the arguments `a` and then `b`.
inline std::vector<std::string> Join(std::vector<std::string> a,
                                     const std::vector<std::string>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

struct ProcessOptions {
  // "NAME=VALUE", in addition to the environment of the test.
  std::vector<std::string> environment;
  // Files can't grow beyond this: writes fail as they do on a full disk. < 0: no limit.
  std::int64_t max_file_bytes = -1;
};

// A child in a process group of its own, with no input. It never outlives the thread that started
// it. Thread-compatible, but Signal and the texts may be used while another thread waits.
class Process {
 public:
  // argv[0] is the path of the program.
  static absl::StatusOr<std::unique_ptr<Process>> Start(const std::vector<std::string>& argv,
                                                        const ProcessOptions& options);
  // Kills the whole group.
  ~Process();

  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  [[nodiscard]] pid_t pid() const { return pid_; }
  void Signal(int number) const;
  // SIGSTOP, and waits until the process stands still.
  void Stop() const;
  // SIGKILL, and waits for its end.
  void Kill();

  // The exit code; 128 + the number of the signal that ended it. DEADLINE_EXCEEDED, with what it
  // printed, if it runs on.
  absl::StatusOr<int> Wait(absl::Duration timeout);

  // The output so far.
  [[nodiscard]] std::string out() const;
  [[nodiscard]] std::string err() const;
  // The first line on standard error that contains `text`, once it is there. FAILED_PRECONDITION if
  // the process ended without it, DEADLINE_EXCEEDED after kPatience; both with all it printed.
  absl::StatusOr<std::string> WaitForErrLine(absl::string_view text);
  // The same on standard output.
  absl::StatusOr<std::string> WaitForOutLine(absl::string_view text);

  // Time on processors so far, of all of its threads; 10 ms steps.
  [[nodiscard]] absl::Duration CpuTime() const;

 private:
  Process() = default;
  bool TryReap(int flags);
  absl::StatusOr<std::string> WaitForLine(const std::string& path, absl::string_view text);

  TempDir captured_;
  pid_t pid_ = -1;
  std::optional<int> exit_code_;
};

struct CommandResult {
  // -1: it could not be started or did not end; `err` says why.
  int exit_code = -1;
  std::string out;
  std::string err;
};

// Runs a command to its end, at most kPatience.
CommandResult RunCommand(const std::vector<std::string>& argv, const ProcessOptions& options);

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_PROCESS_H_
