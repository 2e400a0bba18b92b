// The figures of `bench paper`, drawn by gnuplot from its CSV files and pictures.

#ifndef ISOSCOPE_BENCH_PAPER_BENCH_PLOTS_H_
#define ISOSCOPE_BENCH_PAPER_BENCH_PLOTS_H_

#include <string>
#include <vector>

#include "absl/status/status.h"

#include "bench/paper_bench.h"
#include "bench/paper_bench_report.h"
#include "client-cli/interrupt.h"

namespace isoscope::bench {

// One script for each figure: figure1_pN.gp (N agents), figure1_bound.gp, figure6.gp, figure7.gp,
// figure8.gp, figure9.gp. Run in the folder of the CSV files, each writes an SVG and a PNG under
// its own name.
std::vector<OutputFile> PaperPlotScripts(const PaperBenchResult& result);

// Runs gnuplot on the scripts, which lie in `folder`. NOT_FOUND, with what to install: there is no
// gnuplot. INTERNAL: it failed; with its last words. CANCELLED.
absl::Status DrawPlots(const std::string& folder, const std::vector<OutputFile>& scripts,
                       cli::Interrupt* interrupt);

}  // namespace isoscope::bench

#endif  // ISOSCOPE_BENCH_PAPER_BENCH_PLOTS_H_
