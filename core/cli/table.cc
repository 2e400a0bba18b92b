// ToString, for a terminal of some width:
//
//   1. Widths gives each column the width of its longest cell. While the table is too wide, the
//      widest column loses one character, down to its least width.
//   2. If that is not enough, the columns are shown in parts, one below the other. Each part has
//      the first column, and as many others as fit.
//   3. Part wraps the cells of narrowed columns, and aligns them to the left.
//
// CutLines keeps one line for each row: flexible columns are cut, with ~ at the end.

#include "core/cli/table.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "core/base/check.h"
#include "core/base/printable.h"

namespace isoscope::cli {
namespace {

// Text in narrower columns is not readable.
constexpr std::size_t kLeastWrappedWidth = 16;
constexpr std::size_t kLeastCutWidth = 8;
constexpr std::size_t kNoLimit = std::numeric_limits<std::size_t>::max();

std::string Padded(const std::string& cell, std::size_t width, bool is_left) {
  const std::string padding(width - cell.size(), ' ');
  return is_left ? cell + padding : padding + cell;
}

std::string LineOf(const std::vector<std::string>& padded_cells) {
  std::string line = absl::StrJoin(padded_cells, "  ");
  line.erase(line.find_last_not_of(' ') + 1);
  return line;
}

}  // namespace

Table::Table(const std::vector<std::string>& titles) {
  for (const std::string& title : titles) {
    columns_.push_back({.title = title, .is_left = columns_.empty()});
  }
  AddRow(titles);
}

Table Table::OfColumns(std::vector<Column> columns) {
  Table table;
  std::vector<std::string> titles;
  for (const Column& column : columns) {
    titles.push_back(column.title);
  }
  table.columns_ = std::move(columns);
  table.AddRow(std::move(titles));
  return table;
}

void Table::AddRow(std::vector<std::string> cells) {
  ISOSCOPE_CHECK_EQ(cells.size(), columns_.size());
  for (std::string& cell : cells) {
    cell = base::Printable(cell);
  }
  rows_.push_back(std::move(cells));
}

std::string CutText(std::string text, std::size_t width) {
  if (text.size() > width) {
    text.resize(width);
    if (width > 0) {
      text.back() = '~';
    }
  }
  return text;
}

std::vector<std::string> WrapText(absl::string_view text, std::size_t width) {
  std::vector<std::string> lines;
  while (text.size() > width) {
    // The last place where a line of this width may end.
    const std::size_t space = text.rfind(' ', width);
    const std::size_t joint = text.find_last_of(",/", width - 1);
    std::size_t end = space == absl::string_view::npos ? 0 : space;
    end = std::max(end, joint == absl::string_view::npos ? 0 : joint + 1);
    end = end == 0 ? width : end;
    // A character of UTF-8 is not cut, if one fits at all.
    std::size_t whole = end;
    while (whole > 0 && (static_cast<unsigned char>(text[whole]) & 0xc0U) == 0x80) {
      --whole;
    }
    end = whole > 0 ? whole : end;
    lines.emplace_back(text.substr(0, end));
    text.remove_prefix(end);
    text.remove_prefix(std::min(text.find_first_not_of(' '), text.size()));
  }
  if (!text.empty() || lines.empty()) {
    lines.emplace_back(text);
  }
  return lines;
}

std::string Table::Part(std::size_t begin, std::size_t end,
                        const std::vector<std::size_t>& widths) const {
  std::vector<std::size_t> shown = {0};
  for (std::size_t column = std::max<std::size_t>(begin, 1); column < end; ++column) {
    shown.push_back(column);
  }
  // Columns of wrapped text are aligned to the left.
  const auto is_left = [&](std::size_t column) {
    return columns_[column].is_left ||
           std::any_of(rows_.begin(), rows_.end(),
                       [&](const auto& row) { return row[column].size() > widths[column]; });
  };
  std::string text;
  for (const std::vector<std::string>& row : rows_) {
    std::vector<std::vector<std::string>> cells;
    std::size_t line_count = 1;
    for (const std::size_t column : shown) {
      cells.push_back(WrapText(row[column], widths[column]));
      line_count = std::max(line_count, cells.back().size());
    }
    for (std::size_t i = 0; i < line_count; ++i) {
      std::vector<std::string> padded;
      for (std::size_t j = 0; j < shown.size(); ++j) {
        padded.push_back(
            Padded(i < cells[j].size() ? cells[j][i] : "", widths[shown[j]], is_left(shown[j])));
      }
      absl::StrAppend(&text, LineOf(padded), "\n");
    }
  }
  return text;
}

std::vector<std::size_t> Table::Widths(std::size_t limit,
                                       const std::vector<std::size_t>& least) const {
  std::vector<std::size_t> widths(columns_.size(), 1);
  std::size_t total = 2 * (columns_.size() - 1);
  for (std::size_t column = 0; column < columns_.size(); ++column) {
    for (const std::vector<std::string>& row : rows_) {
      widths[column] = std::max(widths[column], row[column].size());
    }
    total += widths[column];
  }
  for (; total > limit; --total) {
    std::size_t* widest = nullptr;
    for (std::size_t column = 0; column < columns_.size(); ++column) {
      if (widths[column] > std::max(least[column], widest != nullptr ? *widest : 0)) {
        widest = &widths[column];
      }
    }
    if (widest == nullptr) {
      break;
    }
    --*widest;
  }
  return widths;
}

std::string Table::ToString(int max_width) const {
  const std::size_t limit = max_width > 0 ? static_cast<std::size_t>(max_width) : kNoLimit;
  const std::vector<std::size_t> widths =
      Widths(limit, std::vector<std::size_t>(columns_.size(), kLeastWrappedWidth));
  std::string text;
  for (std::size_t begin = 1; begin < columns_.size() || begin == 1;) {
    std::size_t width = widths[0];
    std::size_t end = begin;
    while (end < columns_.size() && (end == begin || width + 2 + widths[end] <= limit)) {
      width += 2 + widths[end++];
    }
    absl::StrAppend(&text, text.empty() ? "" : "\n", Part(begin, end, widths));
    begin = std::max(end, begin + 1);
  }
  return text;
}

std::vector<std::string> Table::CutLines(std::size_t max_width) const {
  std::vector<std::size_t> least;
  for (const Column& column : columns_) {
    least.push_back(column.is_flexible ? kLeastCutWidth : kNoLimit);
  }
  const std::vector<std::size_t> widths = Widths(max_width > 0 ? max_width : kNoLimit, least);
  std::vector<std::string> lines;
  for (const std::vector<std::string>& row : rows_) {
    std::vector<std::string> padded;
    for (std::size_t i = 0; i < row.size(); ++i) {
      padded.push_back(Padded(CutText(row[i], widths[i]), widths[i], columns_[i].is_left));
    }
    lines.push_back(LineOf(padded));
  }
  return lines;
}

}  // namespace isoscope::cli
