#include "bench/csv.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"

#include "core/base/check.h"

namespace isoscope::bench {

CsvTable::CsvTable(std::vector<std::string> header) { rows_.push_back(std::move(header)); }

void CsvTable::AddRow(std::vector<std::string> cells) {
  ISOSCOPE_CHECK_EQ(cells.size(), rows_[0].size());
  rows_.push_back(std::move(cells));
}

std::string CsvTable::ToString() const {
  std::string text;
  for (const std::vector<std::string>& row : rows_) {
    absl::StrAppend(
        &text,
        absl::StrJoin(
            row, ",",
            [](std::string* out, const std::string& cell) {
              if (cell.find_first_of(",\"\r\n") == std::string::npos) {
                absl::StrAppend(out, cell);
              } else {
                absl::StrAppend(out, "\"", absl::StrReplaceAll(cell, {{"\"", "\"\""}}), "\"");
              }
            }),
        "\n");
  }
  return text;
}

std::string CsvNumber(double value) { return absl::StrFormat("%.9g", value); }

}  // namespace isoscope::bench
