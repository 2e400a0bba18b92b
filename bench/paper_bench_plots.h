// The figures of `bench paper`, drawn by gnuplot from its CSV files and pictures.

#ifndef ISOSCOPE_BENCH_PAPER_BENCH_PLOTS_H_
#define ISOSCOPE_BENCH_PAPER_BENCH_PLOTS_H_

#include <string>
#include <vector>

#include "absl/status/status.h"

#include "bench/paper_bench_report.h"
#include "core/cli/interrupt.h"

namespace isoscope::bench {

// The scripts of bench/plots, which are part of the program. Each reads its data from the CSV files
// beside it and writes its figures there, as SVG and as PNG.
std::vector<OutputFile> PaperPlotScripts();

// Runs gnuplot on the scripts, which lie in `folder`. NOT_FOUND, with the package to install: there
// is no gnuplot. INTERNAL: it failed; with its last words. CANCELLED.
absl::Status DrawPlots(const std::string& folder, const std::vector<OutputFile>& scripts,
                       cli::Interrupt* interrupt);

}  // namespace isoscope::bench

#endif  // ISOSCOPE_BENCH_PAPER_BENCH_PLOTS_H_
