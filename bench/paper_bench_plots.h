// The figures of `bench paper`, drawn by gnuplot from its CSV files and pictures.

#ifndef ISOSCOPE_BENCH_PAPER_BENCH_PLOTS_H_
#define ISOSCOPE_BENCH_PAPER_BENCH_PLOTS_H_

#include <string>
#include <vector>

#include "absl/status/status.h"

#include "bench/paper_bench_report.h"
#include "core/cli/interrupt.h"

namespace isoscope::bench {

// Returns the scripts of bench/plots, which are embedded. Each reads its data from the CSV files in
// its folder and writes its figures there, as SVG and as PNG.
std::vector<OutputFile> PaperPlotScripts();

// Runs gnuplot on the scripts in `folder`. NOT_FOUND, with the package to install: gnuplot is
// missing. INTERNAL: it failed; with its last line of output. CANCELLED.
absl::Status DrawPlots(const std::string& folder, const std::vector<OutputFile>& scripts,
                       cli::Interrupt* interrupt);

}  // namespace isoscope::bench

#endif  // ISOSCOPE_BENCH_PAPER_BENCH_PLOTS_H_
