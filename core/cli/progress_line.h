// The progress of long work, as a line for people.

#ifndef ISOSCOPE_CORE_CLI_PROGRESS_LINE_H_
#define ISOSCOPE_CORE_CLI_PROGRESS_LINE_H_

#include <cstdint>
#include <ostream>
#include <streambuf>
#include <string>

#include "absl/strings/string_view.h"
#include "absl/time/time.h"

#include "core/base/monotonic_time.h"

namespace isoscope::cli {

struct Context;

// "reading ranges   42 %  1,024.0 of 2,437.5 MiB  310.2 MiB/s  4 s left".
std::string FormatProgress(absl::string_view phase, std::int64_t done_bytes,
                           std::int64_t total_bytes, absl::Duration elapsed);

// Standard error of a command that was told to be quiet: warnings and errors pass, a ProgressLine
// writes nothing.
class QuietErr final : public std::ostream {
 public:
  explicit QuietErr(std::streambuf* buffer) : std::ostream(buffer) {}
};

// Returns the surroundings of a command that writes no progress to standard error, as QuietContext,
// but text and pictures to standard output. At most one command at a time has them.
Context WithoutProgress(const Context& context);

// Tells how far long work is: on a terminal one line that is written over, with a bar; elsewhere a
// plain line every ten seconds; nothing to a QuietErr. Thread-compatible.
class ProgressLine {
 public:
  // `err` must outlive it.
  ProgressLine(std::ostream* err, bool is_terminal);
  // Clears the line on a terminal.
  ~ProgressLine();
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  // Cheap; draws at most ten times a second. total_bytes > 0.
  void Update(absl::string_view phase, std::int64_t done_bytes, std::int64_t total_bytes);
  // The same with a text in place of the figures, for work of unknown length.
  void Update(absl::string_view text);
  // The same at once, whenever the last one was.
  void UpdateNow(absl::string_view text) { Draw(std::string(text)); }

 private:
  bool IsDue();
  void Draw(const std::string& text);

  std::ostream* const err_;
  const bool is_terminal_;
  const bool is_quiet_;
  const base::MonotonicTime start_;
  base::MonotonicTime last_draw_;
  bool is_drawn_ = false;
};

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CORE_CLI_PROGRESS_LINE_H_
