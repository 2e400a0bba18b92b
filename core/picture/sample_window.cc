#include "core/picture/sample_window.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <type_traits>
#include <vector>

namespace isoscope::picture {
namespace {

// The samples of a histogram that count: all of the bins above a value, a share of the bin that has
// it.
class WeightedSamples {
 public:
  WeightedSamples(volume::ScalarType type, const volume::SampleHistogram& samples, double least)
      : bins_(samples.bins),
        has_exact_bins_(
            samples.bins.exponent == 0 &&
            volume::VisitScalarType(type, []<typename T>() { return std::is_integral_v<T>; })),
        least_(least) {
    weights_.reserve(samples.counts.size());
    for (std::size_t i = 0; i < samples.counts.size(); ++i) {
      weights_.push_back(static_cast<double>(samples.counts[i]) * ShareOf(i));
      total_ += weights_.back();
    }
  }

  [[nodiscard]] bool empty() const { return !(total_ > 0); }

  // The value that `percent` of the samples do not exceed. REQUIRES: not empty.
  [[nodiscard]] double ValueAt(double percent) const {
    const double wanted = total_ * (percent / 100);
    double below = 0;
    double value = 0;
    for (std::size_t i = 0; i < weights_.size(); ++i) {
      if (!(weights_[i] > 0)) {
        continue;
      }
      const double lower = std::max(EdgeOf(i), least_);
      const double share = std::min((wanted - below) / weights_[i], 1.0);
      value = has_exact_bins_ ? EdgeOf(i) : lower + (EdgeOf(i + 1) - lower) * share;
      below += weights_[i];
      if (below >= wanted) {
        break;
      }
    }
    return value;
  }

 private:
  [[nodiscard]] double EdgeOf(std::size_t bin) const {
    return bins_.EdgeOf(static_cast<std::int64_t>(bin));
  }

  // The share of a bin's samples that are at least `least_`.
  [[nodiscard]] double ShareOf(std::size_t bin) const {
    const double lower = EdgeOf(bin);
    const double upper = EdgeOf(bin + 1);
    if (lower >= least_) {
      return 1;
    }
    return has_exact_bins_ || upper <= least_ ? 0 : (upper - least_) / (upper - lower);
  }

  const volume::HistogramBins bins_;
  const bool has_exact_bins_;
  const double least_;
  std::vector<double> weights_;  // by bin
  double total_ = 0;
};

}  // namespace

std::optional<double> LeastSampleOf(const frame::FrameSpec& spec) {
  std::optional<double> least;
  for (const frame::Surface& surface : spec.surfaces) {
    if (surface.is_translucent()) {
      continue;  // it has no caps
    }
    if (surface.rule.has_labels()) {
      return std::nullopt;
    }
    least = std::min(least.value_or(surface.rule.isovalue), surface.rule.isovalue);
  }
  return least;
}

std::optional<volume::ScalarSpan> SpanOfPercentiles(volume::ScalarType type,
                                                    const volume::SampleHistogram& samples,
                                                    const frame::Percentiles& percentiles,
                                                    std::optional<double> least) {
  constexpr double kAll = std::numeric_limits<double>::lowest();
  for (const double from : {least.value_or(kAll), kAll}) {
    const WeightedSamples weighted(type, samples, from);
    if (!weighted.empty()) {
      return volume::ScalarSpan{weighted.ValueAt(percentiles.low),
                                weighted.ValueAt(percentiles.high)};
    }
  }
  return std::nullopt;
}

}  // namespace isoscope::picture
