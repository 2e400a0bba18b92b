// Tables as text for people, and text broken into lines.

#ifndef ISOSCOPE_CORE_CLI_TABLE_H_
#define ISOSCOPE_CORE_CLI_TABLE_H_

#include <cstddef>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"

namespace isoscope::cli {

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

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CORE_CLI_TABLE_H_
