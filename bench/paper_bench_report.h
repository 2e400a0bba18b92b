// The results of `bench paper` as CSV files and as a report.

#ifndef ISOSCOPE_BENCH_PAPER_BENCH_REPORT_H_
#define ISOSCOPE_BENCH_PAPER_BENCH_REPORT_H_

#include <string>
#include <vector>

#include "absl/strings/string_view.h"

#include "bench/machine.h"
#include "bench/paper_bench.h"

namespace isoscope::bench {

struct OutputFile {
  std::string name;
  std::string bytes;
};

// figure1_balance.csv, figure1_bound.csv, figure6.csv, figure7_agents.csv, figure7_speedup.csv,
// figure8.csv, figure9.csv: every measured figure, one row each.
std::vector<OutputFile> PaperTables(const PaperBenchResult& result);

// Facts for the report, besides the figures.
struct PaperReportFacts {
  Machine machine;
  std::string timestamp;
  std::string command = {};
  std::string renderer;
  int run_count = 0;
  int side_px = 0;
  // Empty: plots were drawn; else the reason for missing plots, in one line.
  std::string missing_plots = {};
};

// report.md.
std::string PaperReport(const PaperBenchResult& result, const PaperReportFacts& facts);

// "depth", "mask", "none".
absl::string_view NameOf(frame::Culling culling);

}  // namespace isoscope::bench

#endif  // ISOSCOPE_BENCH_PAPER_BENCH_REPORT_H_
