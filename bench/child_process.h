// Runs other programs to their end, and captures their output.

#ifndef ISOSCOPE_BENCH_CHILD_PROCESS_H_
#define ISOSCOPE_BENCH_CHILD_PROCESS_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/cli/interrupt.h"

namespace isoscope::bench {

struct ChildResult {
  // The exit code; 128 + the number of the signal that ended the process, if one did.
  int exit_code = 0;
  std::string out;
  std::string err;
};

// Runs `argv` in `working_directory` (empty: ours), with no input and in a process group of its
// own: on an interrupt the whole group gets SIGTERM. argv[0]: a path, or a name to find in PATH.
// NOT_FOUND, PERMISSION_DENIED: it can't be started. CANCELLED: interrupted; it has ended.
// An exit code that is not 0 is no error here. Blocks. Thread-safe.
absl::StatusOr<ChildResult> RunChild(const std::vector<std::string>& argv,
                                     const std::string& working_directory,
                                     cli::Interrupt* interrupt);

// Returns the last line of `text` that is not empty: the error of a program that failed.
std::string LastLine(const std::string& text);

}  // namespace isoscope::bench

#endif  // ISOSCOPE_BENCH_CHILD_PROCESS_H_
