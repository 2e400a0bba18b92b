#include "core/cli/table.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/check.h"
#include "core/base/printable.h"

namespace isoscope::cli {
namespace {

std::vector<std::string> AllPrintable(std::vector<std::string> cells) {
  for (std::string& cell : cells) {
    cell = base::Printable(cell);
  }
  return cells;
}

}  // namespace

Table::Table(std::vector<std::string> header) { rows_.push_back(AllPrintable(std::move(header))); }

void Table::AddRow(std::vector<std::string> cells) {
  ISOSCOPE_CHECK_EQ(cells.size(), rows_[0].size());
  rows_.push_back(AllPrintable(std::move(cells)));
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
  std::vector<std::size_t> columns = {0};
  for (std::size_t column = std::max<std::size_t>(begin, 1); column < end; ++column) {
    columns.push_back(column);
  }
  // Columns of text that goes on in the next line begin at one place.
  const auto is_left = [&](std::size_t column) {
    return column == 0 || std::any_of(rows_.begin(), rows_.end(), [&](const auto& row) {
             return row[column].size() > widths[column];
           });
  };
  std::string text;
  for (const std::vector<std::string>& row : rows_) {
    std::vector<std::vector<std::string>> cells;
    std::size_t line_count = 1;
    for (const std::size_t column : columns) {
      cells.push_back(WrapText(row[column], widths[column]));
      line_count = std::max(line_count, cells.back().size());
    }
    for (std::size_t i = 0; i < line_count; ++i) {
      std::string line;
      for (std::size_t j = 0; j < columns.size(); ++j) {
        const std::string cell = i < cells[j].size() ? cells[j][i] : "";
        const std::string padding(widths[columns[j]] - cell.size(), ' ');
        line +=
            absl::StrCat(j == 0 ? "" : "  ", is_left(columns[j]) ? cell + padding : padding + cell);
      }
      line.erase(line.find_last_not_of(' ') + 1);
      text += line + "\n";
    }
  }
  return text;
}

std::string Table::ToString(int max_width) const {
  // Narrower columns would be no text any more.
  constexpr std::size_t kMinTextWidth = 16;
  const std::size_t column_count = rows_[0].size();
  std::vector<std::size_t> widths(column_count);
  std::size_t total = 2 * (column_count - 1);
  for (std::size_t column = 0; column < column_count; ++column) {
    for (const std::vector<std::string>& row : rows_) {
      widths[column] = std::max(widths[column], row[column].size());
    }
    widths[column] = std::max<std::size_t>(widths[column], 1);
    total += widths[column];
  }
  const std::size_t limit =
      max_width > 0 ? static_cast<std::size_t>(max_width) : std::max<std::size_t>(total, 1);
  while (total > limit) {
    const auto widest = std::max_element(widths.begin(), widths.end());
    if (*widest <= kMinTextWidth) {
      break;
    }
    --*widest;
    --total;
  }
  std::string text;
  for (std::size_t begin = 1; begin < column_count || begin == 1;) {
    std::size_t width = widths[0];
    std::size_t end = begin;
    while (end < column_count && (end == begin || width + 2 + widths[end] <= limit)) {
      width += 2 + widths[end++];
    }
    absl::StrAppend(&text, text.empty() ? "" : "\n", Part(begin, end, widths));
    begin = std::max(end, begin + 1);
  }
  return text;
}

}  // namespace isoscope::cli
