// Tables as CSV files.

#ifndef ISOSCOPE_BENCH_CSV_H_
#define ISOSCOPE_BENCH_CSV_H_

#include <string>
#include <vector>

namespace isoscope::bench {

// Comma-separated values with a header line (RFC 4180, lines end in a line feed).
class CsvTable {
 public:
  explicit CsvTable(std::vector<std::string> header);

  // REQUIRES: as many cells as the header has.
  void AddRow(std::vector<std::string> cells);
  // Cells with commas, quotes or line ends are quoted.
  [[nodiscard]] std::string ToString() const;

 private:
  std::vector<std::vector<std::string>> rows_;
};

// Returns nine significant digits, with a decimal point whatever the locale.
std::string CsvNumber(double value);

}  // namespace isoscope::bench

#endif  // ISOSCOPE_BENCH_CSV_H_
