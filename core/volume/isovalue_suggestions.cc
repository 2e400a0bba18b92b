#include "core/volume/isovalue_suggestions.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <type_traits>
#include <utility>

#include "core/base/check.h"

namespace isoscope::volume {
namespace {

constexpr double kEnclosedShare = 0.01;
// The tolerance within which classes count as equally good. Moving the border through an empty gap
// changes only the order of the sums.
constexpr double kTieTolerance = 1e-12;

// The bins that hold samples, ascending, and how many.
struct FilledBin {
  std::int64_t index = 0;
  std::int64_t count = 0;
};

std::vector<FilledBin> FilledBinsOf(const SampleHistogram& histogram, std::int64_t begin,
                                    std::int64_t end) {
  std::vector<FilledBin> filled;
  for (std::int64_t i = begin; i < end; ++i) {
    if (const std::int64_t count = histogram.counts[static_cast<std::size_t>(i)]; count > 0) {
      filled.push_back({i, count});
    }
  }
  return filled;
}

class Suggester {
 public:
  Suggester(ScalarType type, const HistogramBins& bins, std::vector<FilledBin> filled)
      : bins_(bins), filled_(std::move(filled)) {
    is_integer_ = VisitScalarType(type, []<typename T>() { return std::is_integral_v<T>; });
    for (const FilledBin& bin : filled_) {
      total_ += static_cast<double>(bin.count);
    }
  }

  [[nodiscard]] std::vector<IsovalueSuggestion> Run() const {
    if (filled_.size() < 2) {
      return {};
    }
    return {BetweenClasses(), OnePercent()};
  }

 private:
  // The largest and the smallest sample that the bin of filled_[k] can hold.
  [[nodiscard]] double LastOf(std::size_t k) const {
    return bins_.EdgeOf(filled_[k].index + 1) - (is_integer_ ? 1 : 0);
  }
  [[nodiscard]] double FirstOf(std::size_t k) const { return bins_.EdgeOf(filled_[k].index); }

  [[nodiscard]] IsovalueSuggestion BetweenClasses() const {
    // Border k: filled_[0, k] are the lower class. The variance between the classes, in bins:
    // w0 * w1 * (mean1 - mean0)^2.
    double sum = 0;
    for (const FilledBin& bin : filled_) {
      sum += static_cast<double>(bin.count) * static_cast<double>(bin.index - filled_[0].index);
    }
    std::vector<double> variances;
    double lower_count = 0;
    double lower_sum = 0;
    for (std::size_t k = 0; k + 1 < filled_.size(); ++k) {
      const auto count = static_cast<double>(filled_[k].count);
      lower_count += count;
      lower_sum += count * static_cast<double>(filled_[k].index - filled_[0].index);
      const double upper_count = total_ - lower_count;
      const double difference = (sum - lower_sum) / upper_count - lower_sum / lower_count;
      variances.push_back(lower_count / total_ * (upper_count / total_) * difference * difference);
    }
    const double best = *std::max_element(variances.begin(), variances.end());
    const auto is_best = [&](double v) { return v >= best * (1 - kTieTolerance); };
    const auto first = static_cast<std::size_t>(
        std::find_if(variances.begin(), variances.end(), is_best) - variances.begin());
    const auto last = static_cast<std::size_t>(
        variances.rend() - std::find_if(variances.rbegin(), variances.rend(), is_best) - 1);
    const double isovalue = 0.5 * LastOf(first) + 0.5 * FirstOf(last + 1);
    return {SuggestionMethod::kBetweenClasses, isovalue, FractionFrom(isovalue)};
  }

  [[nodiscard]] IsovalueSuggestion OnePercent() const {
    std::size_t k = filled_.size() - 1;
    double enclosed = static_cast<double>(filled_[k].count);
    while (k > 1 && enclosed < kEnclosedShare * total_) {
      --k;
      enclosed += static_cast<double>(filled_[k].count);
    }
    const double isovalue = FirstOf(k) - (is_integer_ ? 0.5 : 0);
    return {SuggestionMethod::kOnePercent, isovalue, enclosed / total_};
  }

  // The share of samples in bins that begin at `isovalue` or above.
  [[nodiscard]] double FractionFrom(double isovalue) const {
    double count = 0;
    for (std::size_t k = 0; k < filled_.size(); ++k) {
      count += FirstOf(k) >= isovalue ? static_cast<double>(filled_[k].count) : 0;
    }
    return count / total_;
  }

  const HistogramBins bins_;
  const std::vector<FilledBin> filled_;
  bool is_integer_ = false;
  double total_ = 0;
};

}  // namespace

std::vector<IsovalueSuggestion> SuggestIsovalues(ScalarType type, const SampleHistogram& histogram,
                                                 std::int64_t begin, std::int64_t end) {
  ISOSCOPE_CHECK(0 <= begin && end <= histogram.bins.count);
  return Suggester(type, histogram.bins, FilledBinsOf(histogram, begin, end)).Run();
}

}  // namespace isoscope::volume
