// Tables as text for people, and text broken into lines.

#ifndef ISOSCOPE_CORE_CLI_TABLE_H_
#define ISOSCOPE_CORE_CLI_TABLE_H_

#include <cstddef>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"

namespace isoscope::cli {

// Rows of printable cells in aligned columns, two spaces apart, without spaces at the ends of
// lines.
class Table {
 public:
  struct Column {
    std::string title;
    bool is_left = false;      // else cells are aligned to the right
    bool is_flexible = false;  // CutLines may make it narrower
  };
  // The first column is aligned to the left, all others to the right.
  explicit Table(const std::vector<std::string>& titles);
  static Table OfColumns(std::vector<Column> columns);

  // REQUIRES: as many cells as there are columns.
  void AddRow(std::vector<std::string> cells);
  // Lines that end in a line feed.
  //
  // max_width: characters of a line, 0 for no limit. A wider table gets narrower columns of text,
  // whose cells are wrapped. If that is not enough, the remaining columns follow below, with the
  // first column repeated.
  [[nodiscard]] std::string ToString(int max_width = 0) const;
  // A line for each row, the titles first. A table wider than `max_width` (0: no limit) gets
  // narrower flexible columns, whose cells are cut (CutText); lines may still be longer.
  [[nodiscard]] std::vector<std::string> CutLines(std::size_t max_width) const;

 private:
  Table() = default;
  // The widths of all columns. The widest of those above their least width gives way until a line
  // has at most `limit` characters.
  [[nodiscard]] std::vector<std::size_t> Widths(std::size_t limit,
                                                const std::vector<std::size_t>& least) const;
  // The part of the table with the first column and [begin, end).
  [[nodiscard]] std::string Part(std::size_t begin, std::size_t end,
                                 const std::vector<std::size_t>& widths) const;

  std::vector<Column> columns_;
  std::vector<std::vector<std::string>> rows_;  // the titles first
};

// The first `width` characters of a longer text, the last of them "~".
std::string CutText(std::string text, std::size_t width);

// Lines of at most `width` characters (>= 1), broken at spaces and behind commas and slashes, in
// the middle of a word only if there is none. At least one line.
std::vector<std::string> WrapText(absl::string_view text, std::size_t width);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CORE_CLI_TABLE_H_
