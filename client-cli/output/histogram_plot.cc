#include "client-cli/output/histogram_plot.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include <nlohmann/json.hpp>
#include <sys/ioctl.h>

#include "client-cli/output/round_value.h"
#include "core/cli/format.h"
#include "core/cli/table.h"

namespace isoscope::cli {
namespace {

namespace v1 = isoscope::v1;
using Json = nlohmann::ordered_json;

constexpr int kMinWidth = 40;
constexpr int kPlotRows = 12;
constexpr int kTableRows = 10;
// Eighths of a character, from the bottom.
constexpr std::array<const char*, 9> kEighths{" ", "▁", "▂", "▃", "▄", "▅", "▆", "▇", "█"};

std::string Number(double value) { return absl::StrFormat("%.6g", value); }

// A value of the histogram, with as many digits as its range asks for. REQUIRES: there are bins.
std::string ValueIn(const v1::GetHistogramResponse& histogram, double value) {
  return FormatValue(RoundedValue(value, histogram.bins(0).min(),
                                  histogram.bins(histogram.bins_size() - 1).max()));
}

const char* NameOf(v1::IsovalueSuggestion::Method method) {
  return method == v1::IsovalueSuggestion::METHOD_ONE_PERCENT ? "one_percent" : "between_classes";
}

// "1.2M", "34k", "512": at most five characters up to 999 million million.
std::string ShortCount(double value) {
  constexpr std::array<const char*, 5> kUnits{"", "k", "M", "G", "T"};
  std::size_t unit = 0;
  while (value >= 999.5 && unit + 1 < kUnits.size()) {
    value /= 1000;
    ++unit;
  }
  return absl::StrCat(absl::StrFormat(unit == 0 || value >= 99.95 ? "%.0f" : "%.1f", value),
                      kUnits[unit]);
}

// The bars of a plot: neighbouring bins are merged until they fit.
struct Bars {
  double min = 0;
  double max = 0;
  std::vector<double> heights;

  [[nodiscard]] double largest() const {
    return heights.empty() ? 0 : *std::max_element(heights.begin(), heights.end());
  }
};

Bars BarsOf(const v1::GetHistogramResponse& histogram, int max_count) {
  const int bins_per_bar = (histogram.bins_size() + max_count - 1) / max_count;
  Bars bars;
  bars.min = histogram.bins(0).min();
  bars.max = histogram.bins(histogram.bins_size() - 1).max();
  for (int i = 0; i < histogram.bins_size(); ++i) {
    if (i % bins_per_bar == 0) {
      bars.heights.push_back(0);
    }
    const v1::HistogramBin& bin = histogram.bins(i);
    double& height = bars.heights.back();
    height = histogram.has_sample_counts()
                 ? height + static_cast<double>(bin.sample_count())
                 : std::max(height, static_cast<double>(bin.active_block_count()));
  }
  return bars;
}

// Returns the height of a bar as a share of the largest, in [0, 1].
double ShareOf(double height, double largest, bool is_logarithmic) {
  if (height <= 0 || largest <= 0) {
    return 0;
  }
  return is_logarithmic ? std::log1p(height) / std::log1p(largest) : height / largest;
}

std::string DrawBars(const Bars& bars, const PlotOptions& options) {
  std::string text;
  for (int row = kPlotRows - 1; row >= 0; --row) {
    std::string label = row == kPlotRows - 1 ? ShortCount(bars.largest()) : row == 0 ? "0" : "";
    std::string line = absl::StrFormat("%7s |", label);
    for (const double height : bars.heights) {
      double share = ShareOf(height, bars.largest(), options.is_logarithmic);
      // A bar that is not empty has at least one eighth.
      share = height > 0 ? std::max(share, 1.0 / (8 * kPlotRows)) : share;
      const double eighths = share * 8 * kPlotRows - 8.0 * row;
      line += kEighths[static_cast<std::size_t>(std::clamp(std::lround(eighths), 0L, 8L))];
    }
    absl::StrAppend(&text, line.substr(0, line.find_last_not_of(' ') + 1), "\n");
  }
  const int columns = static_cast<int>(bars.heights.size());
  const std::string min = Number(bars.min);
  const std::string max = Number(bars.max);
  const int gap = std::max(columns - static_cast<int>(min.size() + max.size()), 1);
  absl::StrAppend(&text, std::string(8, ' '), "+", std::string(bars.heights.size(), '-'), "\n",
                  std::string(9, ' '), min, std::string(static_cast<std::size_t>(gap), ' '), max,
                  "\n");
  return text;
}

std::string DrawCosts(const v1::GetHistogramResponse& histogram) {
  Table table({"isovalue", "active blocks", "their size", "triangles, about"});
  const int rows = std::min(kTableRows, histogram.bins_size());
  for (int row = 0; row < rows; ++row) {
    const int i = static_cast<int>((row + 0.5) * histogram.bins_size() / rows);
    const v1::HistogramBin& bin = histogram.bins(i);
    table.AddRow({ValueIn(histogram, 0.5 * bin.min() + 0.5 * bin.max()),
                  FormatCount(bin.active_block_count()), FormatMebibytes(bin.active_block_bytes()),
                  ShortCount(static_cast<double>(bin.estimated_triangle_count()))});
  }
  return table.ToString();
}

std::string DescribeSuggestion(const v1::GetHistogramResponse& histogram,
                               const v1::IsovalueSuggestion& suggestion) {
  return absl::StrFormat(
      "  --isovalue %-12s %s (%.3g %% inside)\n", ValueIn(histogram, suggestion.isovalue()),
      suggestion.method() == v1::IsovalueSuggestion::METHOD_ONE_PERCENT ? "encloses one percent"
                                                                        : "between two classes",
      100 * suggestion.inside_fraction());
}

std::string DescribeApart(const v1::GetHistogramResponse& histogram) {
  std::string text;
  for (const auto& [count, name] : {std::pair(histogram.nan_count(), "NaN"),
                                    std::pair(histogram.negative_infinity_count(), "-inf"),
                                    std::pair(histogram.positive_infinity_count(), "inf")}) {
    if (count > 0) {
      absl::StrAppend(&text, "and ", FormatCount(count), " samples of ", name, "\n");
    }
  }
  return text;
}

}  // namespace

std::string DrawHistogram(const v1::GetHistogramResponse& histogram, const PlotOptions& options) {
  if (histogram.bins().empty()) {
    return absl::StrCat("no sample is finite\n", DescribeApart(histogram));
  }
  const int columns = std::max(options.width, kMinWidth) - 9;
  std::string text =
      histogram.has_sample_counts() ? "samples by value" : "active blocks by isovalue";
  absl::StrAppend(&text, options.is_logarithmic ? " (logarithmic)\n" : "\n",
                  DrawBars(BarsOf(histogram, columns), options), DescribeApart(histogram), "\n",
                  DrawCosts(histogram), "\n");
  if (!histogram.has_sample_counts()) {
    absl::StrAppend(&text, "samples were not counted when this was partitioned: partition it\n",
                    "anew for counts and suggestions\n");
  } else if (!histogram.suggested_labels().empty()) {
    absl::StrAppend(&text, "suggested:\n", absl::StrFormat("  %-23s ", "--labels all"),
                    "the samples are labels, it seems: ", histogram.suggested_labels_size(), "\n");
  } else if (histogram.suggestions().empty()) {
    absl::StrAppend(&text, "no isovalue is suggested: all samples lie in one bin\n");
  } else {
    absl::StrAppend(&text, "suggested:\n");
    for (const v1::IsovalueSuggestion& suggestion : histogram.suggestions()) {
      absl::StrAppend(&text, DescribeSuggestion(histogram, suggestion));
    }
  }
  return text;
}

Json HistogramToJson(const v1::GetHistogramResponse& histogram) {
  Json json;
  json["has_sample_counts"] = histogram.has_sample_counts();
  json["nan_count"] = histogram.nan_count();
  json["negative_infinity_count"] = histogram.negative_infinity_count();
  json["positive_infinity_count"] = histogram.positive_infinity_count();
  json["bins"] = Json::array();
  for (const v1::HistogramBin& bin : histogram.bins()) {
    json["bins"].push_back({{"min", bin.min()},
                            {"max", bin.max()},
                            {"sample_count", bin.sample_count()},
                            {"active_block_count", bin.active_block_count()},
                            {"active_block_bytes", bin.active_block_bytes()},
                            {"estimated_triangle_count", bin.estimated_triangle_count()}});
  }
  json["suggestions"] = Json::array();
  for (const v1::IsovalueSuggestion& suggestion : histogram.suggestions()) {
    json["suggestions"].push_back({{"method", NameOf(suggestion.method())},
                                   {"isovalue", suggestion.isovalue()},
                                   {"inside_fraction", suggestion.inside_fraction()}});
  }
  json["suggested_labels"] = Json::array();
  for (const double label : histogram.suggested_labels()) {
    json["suggested_labels"].push_back(label);
  }
  return json;
}

int TerminalWidth() {
  constexpr int kDefaultWidth = 80;
  winsize size{};
  const bool is_terminal = ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
  return is_terminal ? std::max<int>(size.ws_col, kMinWidth) : kDefaultWidth;
}

}  // namespace isoscope::cli
