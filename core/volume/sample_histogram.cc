// BinsOf finds the finest grid of bins on which the range of the samples has at most
// kMaxHistogramBins:
//
//   1. Integers begin at exponent 0. Floats begin where a bin is the last bit of the largest
//      magnitude, because finer bins separate no values.
//   2. The width of the range gives a first guess, at most 2 below the result.
//   3. Each further exponent halves the count, until it fits.
//
// GroupBins cuts the bins of a range into groups of equal size, as many as an answer may have.
// AddPart adds the answer of another agent: bins and range of one dataset are equal, so others are
// an error.

#include "core/volume/sample_histogram.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <type_traits>

#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/math/elementary.h"

namespace isoscope::volume {
namespace {

// The mantissa bits of a double. Bins finer than its last bit separate no values.
constexpr int kMantissaBits = 52;

bool IsInteger(ScalarType type) {
  return VisitScalarType(type, []<typename T>() { return std::is_integral_v<T>; });
}

// The bin of a value on the grid of `exponent`, counted from 0.
std::int64_t GridIndex(double value, int exponent) {
  const double scaled = std::ldexp(value, -exponent);
  // A negative value may underflow to 0, but belongs below it.
  return value < 0 && scaled > -1 ? -1 : static_cast<std::int64_t>(std::floor(scaled));
}

// The smallest exponent at which bins index doubles of this size exactly.
int MinExponentOf(double magnitude) {
  return magnitude == 0 ? kMinHistogramExponent
                        : std::max(kMinHistogramExponent, std::ilogb(magnitude) - kMantissaBits);
}

}  // namespace

double HistogramBins::EdgeOf(std::int64_t i) const {
  constexpr double kLargest = std::numeric_limits<double>::max();
  return std::clamp(std::ldexp(static_cast<double>(first + i), exponent), -kLargest, kLargest);
}

std::int64_t HistogramBins::IndexOf(double value) const {
  return GridIndex(value, exponent) - first;
}

HistogramBins BinsOf(ScalarType type, const ScalarSpan& finite_range) {
  if (!(finite_range.min <= finite_range.max)) {
    return {};
  }
  ISOSCOPE_CHECK(std::isfinite(finite_range.min) && std::isfinite(finite_range.max));
  HistogramBins bins;
  bins.exponent =
      IsInteger(type)
          ? 0
          : MinExponentOf(std::max(std::abs(finite_range.min), std::abs(finite_range.max)));
  // The first guess is at most 2 below the result.
  const double width = finite_range.max * 0.5 - finite_range.min * 0.5;
  if (width > 0) {
    bins.exponent = std::max(bins.exponent, std::ilogb(width) - 12);
  }
  for (;; ++bins.exponent) {
    bins.first = GridIndex(finite_range.min, bins.exponent);
    bins.count = GridIndex(finite_range.max, bins.exponent) - bins.first + 1;
    if (bins.count <= kMaxHistogramBins) {
      return bins;
    }
  }
}

math::IndexBox CountedSamplesOf(const BlockLayout& layout, BlockId id) {
  math::IndexBox samples = layout.CellsOf(id);
  for (int axis = 0; axis < 3; ++axis) {
    if (samples.end[axis] == layout.sample_dims()[axis] - 1) {
      ++samples.end[axis];
    }
  }
  return samples;
}

std::int64_t SampleHistogram::TotalCount() const {
  std::int64_t total = nan_count + negative_infinity_count + positive_infinity_count;
  for (const std::int64_t count : counts) {
    total += count;
  }
  return total;
}

void SampleHistogram::Add(const SampleHistogram& other) {
  ISOSCOPE_CHECK(bins == other.bins);
  for (std::size_t i = 0; i < counts.size(); ++i) {
    counts[i] += other.counts[i];
  }
  nan_count += other.nan_count;
  negative_infinity_count += other.negative_infinity_count;
  positive_infinity_count += other.positive_infinity_count;
}

std::int64_t BinGroups::EndOf(std::int64_t group) const {
  return std::min(begin + (group + 1) * size, bins.count);
}

std::int64_t BinGroups::SumOf(const std::vector<std::int64_t>& counts, std::int64_t group) const {
  std::int64_t sum = 0;
  for (std::int64_t i = begin + group * size; i < EndOf(group); ++i) {
    sum += counts[static_cast<std::size_t>(i)];
  }
  return sum;
}

absl::StatusOr<BinGroups> GroupBins(const HistogramBins& bins, std::int64_t max_count,
                                    const std::optional<ScalarSpan>& range) {
  ISOSCOPE_CHECK_GE(max_count, 1);
  BinGroups groups{.bins = bins, .begin = 0, .size = 1, .count = 0};
  std::int64_t end = bins.count;
  if (range.has_value()) {
    const double last_edge = bins.EdgeOf(bins.count);
    if (bins.count == 0 || range->max < bins.EdgeOf(0) || range->min >= last_edge) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "range %g to %g: no sample is in it; %s", range->min, range->max,
          bins.count == 0
              ? "the volume has no finite sample"
              : absl::StrFormat("the samples lie in %g to %g", bins.EdgeOf(0), last_edge)));
    }
    // Values far outside are cut off first: their indices could overflow.
    groups.begin = range->min <= bins.EdgeOf(0) ? 0 : bins.IndexOf(range->min);
    end = range->max >= last_edge ? bins.count : bins.IndexOf(range->max) + 1;
  }
  const std::int64_t bin_count = end - groups.begin;
  groups.size = std::max<std::int64_t>((bin_count + max_count - 1) / max_count, 1);
  groups.count = (bin_count + groups.size - 1) / groups.size;
  return groups;
}

absl::Status AddPart(const HistogramPart& other, HistogramPart* sum) {
  if (!(other.groups == sum->groups)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%d bins of 2^%d * %d, expected %d of 2^%d * %d: shards of different datasets",
        other.groups.count, other.groups.bins.exponent, other.groups.size, sum->groups.count,
        sum->groups.bins.exponent, sum->groups.size));
  }
  const bool is_told = other.value_range.min <= other.value_range.max;
  const bool is_known = sum->value_range.min <= sum->value_range.max;
  if (is_told && is_known && !(other.value_range == sum->value_range)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "samples in %g to %g, expected %g to %g: shards of different datasets",
        other.value_range.min, other.value_range.max, sum->value_range.min, sum->value_range.max));
  }
  sum->value_range = is_known ? sum->value_range : other.value_range;
  for (std::size_t i = 0; i < sum->active_block_counts.size(); ++i) {
    sum->active_block_counts[i] += other.active_block_counts[i];
    sum->active_block_bytes[i] += other.active_block_bytes[i];
    sum->estimated_triangle_counts[i] += other.estimated_triangle_counts[i];
  }
  if (sum->samples.has_value() && other.samples.has_value()) {
    sum->samples->Add(*other.samples);
  } else {
    sum->samples.reset();
  }
  if (sum->label_values.has_value() && other.label_values.has_value()) {
    sum->label_values->Add(*other.label_values);
  } else {
    sum->label_values.reset();
  }
  return absl::OkStatus();
}

std::int64_t EstimateTriangles(const math::Index3& block_cells) {
  const double edge = math::Cbrt(static_cast<double>(math::Volume(block_cells)));
  return std::llround(kTrianglesPerFaceCell * edge * edge);
}

}  // namespace isoscope::volume
