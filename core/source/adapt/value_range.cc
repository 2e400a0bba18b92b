#include "core/source/adapt/value_range.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <memory>
#include <type_traits>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/volume/label_suggestion.h"
#include "core/volume/min_max.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kPortionBytes = 8 * base::kMiB;

// Adds samples of which some are not finite, one by one.
template <typename T>
void AddOneByOne(const char* samples, std::size_t count, ValueRange* range) {
  for (std::size_t i = 0; i < count; ++i) {
    const auto value = static_cast<double>(base::LoadLittleEndian<T>(samples + i * sizeof(T)));
    if (std::isfinite(value)) {
      range->span.min = std::min(range->span.min, value + 0.0);
      range->span.max = std::max(range->span.max, value + 0.0);
    } else if (!std::isnan(value)) {
      ++range->infinite_count;
    }
  }
}

template <typename T>
void AddSamples(const char* samples, std::size_t count, ValueRange* range) {
  volume::MinMax<T> min_max;
  min_max.AddRow(samples, count);
  const volume::ScalarSpan span = min_max.Get();
  if (span.min > span.max) {
    return;  // NaN alone
  }
  if (!std::isfinite(span.min) || !std::isfinite(span.max)) {
    AddOneByOne<T>(samples, count, range);
    return;
  }
  range->span.min = std::min(range->span.min, span.min);
  range->span.max = std::max(range->span.max, span.max);
}

// Counts integers as long as they have few different values.
class FewValues {
 public:
  template <typename T>
  void Add(const char* samples, std::size_t count) {
    if (!std::is_integral_v<T> || has_too_many_) {
      has_too_many_ = true;
      return;
    }
    // Labels come in runs.
    for (std::size_t i = 0; i < count && !has_too_many_;) {
      const T value = base::LoadLittleEndian<T>(samples + i * sizeof(T));
      const std::size_t first = i;
      do {
        ++i;
      } while (i < count && base::LoadLittleEndian<T>(samples + i * sizeof(T)) == value);
      counts_[static_cast<std::int64_t>(value)] += static_cast<std::int64_t>(i - first);
      has_too_many_ = counts_.size() > volume::kMaxSuggestedLabels + 1;
    }
  }

  // Not set if there are too many, or if their bins are not exact.
  [[nodiscard]] std::optional<volume::SampleHistogram> Histogram(volume::ScalarType type) const {
    if (has_too_many_ || counts_.empty()) {
      return std::nullopt;
    }
    volume::SampleHistogram histogram;
    histogram.bins = volume::BinsOf(type, {.min = static_cast<double>(counts_.begin()->first),
                                           .max = static_cast<double>(counts_.rbegin()->first)});
    if (histogram.bins.exponent != 0) {
      return std::nullopt;
    }
    histogram.counts.resize(static_cast<std::size_t>(histogram.bins.count));
    for (const auto& [value, count] : counts_) {
      histogram
          .counts[static_cast<std::size_t>(histogram.bins.IndexOf(static_cast<double>(value)))] =
          count;
    }
    return histogram;
  }

 private:
  std::map<std::int64_t, std::int64_t> counts_;
  bool has_too_many_ = false;
};

}  // namespace

absl::StatusOr<ValueRange> FindValueRange(
    VolumeSource* source, const std::function<void(std::int64_t, std::int64_t)>& progress,
    const base::Cancellation& cancellation, std::optional<volume::SampleHistogram>* few_values) {
  const math::Index3& dims = source->info().geometry.sample_dims;
  const std::int64_t row_count = dims.y * dims.z;
  const auto row_bytes = source->info().row_bytes();
  const std::int64_t portion_rows =
      std::clamp<std::int64_t>(kPortionBytes / row_bytes, 1, row_count);
  const CancellableReads reads(source, cancellation);
  const auto portion =
      std::make_unique_for_overwrite<char[]>(static_cast<std::size_t>(portion_rows * row_bytes));
  return volume::VisitScalarType(
      source->info().type, [&]<typename T>() -> absl::StatusOr<ValueRange> {
        ValueRange range;
        FewValues few;
        for (std::int64_t row = 0; row < row_count;) {
          ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
          const std::int64_t end = std::min(row + portion_rows, row_count);
          ISOSCOPE_RETURN_IF_ERROR(source->ReadRows(row, end, portion.get()));
          const auto count = static_cast<std::size_t>((end - row) * dims.x);
          AddSamples<T>(portion.get(), count, &range);
          if (few_values != nullptr) {
            few.Add<T>(portion.get(), count);
          }
          row = end;
          if (progress) {
            progress(row * row_bytes, row_count * row_bytes);
          }
        }
        if (few_values != nullptr) {
          *few_values = few.Histogram(source->info().type);
        }
        return range;
      });
}

std::string MiddleIsovalue(const volume::ScalarSpan& span) {
  if (!(span.min < span.max)) {
    return "";
  }
  // Halves first: the sum of large numbers would overflow.
  const double middle = span.min / 2 + span.max / 2;
  for (const int digits : {6, 9, 17}) {
    const std::string text = absl::StrFormat("%.*g", digits, middle);
    double number = 0;
    if (absl::SimpleAtod(text, &number) && volume::IsActive(span, number)) {
      return text;
    }
  }
  return absl::StrFormat("%.17g", span.max);  // neighbours, or as small as numbers get
}

}  // namespace isoscope::source
