// Text for people: numbers, tables, progress; and files that appear whole or not at all.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_H_

#include <cstddef>
#include <cstdint>
#include <fstream>
#include <iosfwd>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

#include "core/io/file.h"

namespace isoscope::cli {

// "-1,234,567".
std::string FormatCount(std::int64_t value);
// "1,234.5 MiB"; always MiB, one decimal.
std::string FormatMebibytes(std::int64_t bytes);
// "1,234.5": milliseconds, one decimal.
std::string FormatMilliseconds(double milliseconds);
// "41 s", "3 min 05 s", "2 h 07 min"; >= 0.
std::string FormatElapsed(absl::Duration duration);

// Rows of printable cells in aligned columns: the first one to the left, all others to the right.
class Table {
 public:
  explicit Table(std::vector<std::string> header);

  // REQUIRES: as many cells as the header has.
  void AddRow(std::vector<std::string> cells);
  // Two spaces between columns, lines end in a line feed, no spaces at their ends.
  //
  // max_width: characters of a line, 0 for no limit. A wider table gets narrower columns of text,
  // whose cells go on in the next line; if that is not enough, the columns that are left over
  // follow below, behind the first column once more.
  [[nodiscard]] std::string ToString(int max_width = 0) const;

 private:
  // The part of the table with the first column and [begin, end).
  [[nodiscard]] std::string Part(std::size_t begin, std::size_t end,
                                 const std::vector<std::size_t>& widths) const;

  std::vector<std::vector<std::string>> rows_;
};

// Lines of at most `width` characters (>= 1), broken at spaces and behind commas and slashes, in
// the middle of a word only if there is none. At least one line.
std::vector<std::string> WrapText(absl::string_view text, std::size_t width);

// "reading ranges   42 %  1,024.0 of 2,437.5 MiB  310.2 MiB/s  4 s left".
std::string FormatProgress(absl::string_view phase, std::int64_t done_bytes,
                           std::int64_t total_bytes, absl::Duration elapsed);

// Tells how far long work is: on a terminal one line that is written over, with a bar; elsewhere a
// plain line every ten seconds. Thread-compatible.
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
  const absl::Time start_;
  absl::Time last_draw_;
  bool is_drawn_ = false;
};

// UsageError if the name of `path` has another suffix than `suffix` (".png"; letters of any case):
// it would promise a format that is not written. A name without a suffix promises nothing, nor does
// a device or a pipe. `format` says what is written: "PNG".
absl::Status CheckSuffix(const std::string& path, absl::string_view suffix,
                         absl::string_view format);

// OK if a file can be made at `path`, or one there be replaced; leaves no trace. Errors name the
// path and the reason.
absl::Status CheckWritable(const std::string& path);

// Writes `bytes` to `path` under another name first and renames it: `path` is the old file or the
// whole new one. A device or a pipe is written as it is.
absl::Status WriteFileAtomically(const std::string& path, absl::string_view bytes);

// A file that is written piece by piece and appears whole, in one step, or not at all. A device or
// a pipe is written as it is. Thread-compatible.
class AtomicFile {
 public:
  // Errors as io::CreateWritableFile.
  static absl::StatusOr<std::unique_ptr<AtomicFile>> Create(const std::string& path);
  // Removes what was written unless Commit was called.
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  absl::Status Append(absl::string_view bytes);
  // Gives the file its name. Call it once, last.
  absl::Status Commit();

  [[nodiscard]] std::int64_t size_bytes() const { return size_bytes_; }

 private:
  explicit AtomicFile(const std::string& path);

  const std::string path_;
  const std::string partial_path_;          // empty for a device or a pipe
  std::unique_ptr<io::WritableFile> file_;  // null for a device or a pipe
  std::unique_ptr<std::ofstream> special_;  // for those
  std::int64_t size_bytes_ = 0;
  bool is_committed_ = false;
};

// The name under which `path` is written before it is whole; of this process alone.
std::string PartialName(const std::string& path);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_H_
