// A histogram as a plot for terminals, and as JSON for programs.
//
// Steps of the plot: neighbouring bins are merged until one bar takes one column, heights become
// eighths of a character (linear or logarithmic), and suggestions follow as lines.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_HISTOGRAM_PLOT_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_HISTOGRAM_PLOT_H_

#include <string>

#include <nlohmann/json_fwd.hpp>

#include "isoscope/v1/dataset_service.pb.h"

namespace isoscope::cli {

struct PlotOptions {
  int width = 80;               // characters of a line, >= 40
  bool is_logarithmic = false;  // heights by the logarithm of the counts
};

// Returns bars of samples over values (of active blocks, if no samples were counted), a table of
// the costs of surfaces at some isovalues, and the suggestions. No line exceeds the width, or 72.
std::string DrawHistogram(const isoscope::v1::GetHistogramResponse& histogram,
                          const PlotOptions& options);

// {"has_sample_counts", "nan_count", "negative_infinity_count", "positive_infinity_count",
// "bins": [{"min", "max", "sample_count", "active_block_count", "active_block_bytes",
// "estimated_triangle_count"}], "suggestions": [{"method", "isovalue", "inside_fraction"}],
// "suggested_labels": [values]}; method is "between_classes" or "one_percent".
nlohmann::ordered_json HistogramToJson(const isoscope::v1::GetHistogramResponse& histogram);

// Returns the columns of the terminal on standard output; 80 if it is no terminal.
int TerminalWidth();

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_HISTOGRAM_PLOT_H_
