// The range of a volume's values, without cutting it into blocks, and an isovalue in it.

#ifndef ISOSCOPE_CORE_SOURCE_ADAPT_VALUE_RANGE_H_
#define ISOSCOPE_CORE_SOURCE_ADAPT_VALUE_RANGE_H_

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/source/volume_source.h"
#include "core/volume/sample_histogram.h"
#include "core/volume/scalar_span.h"

namespace isoscope::source {

struct ValueRange {
  volume::ScalarSpan span;  // of the finite samples: what Partition writes as the value_range
  std::int64_t infinite_count = 0;

  friend bool operator==(const ValueRange&, const ValueRange&) = default;
};

// Reads the volume once, in portions of at most 8 MiB (or one row). Errors as ReadRows; CANCELLED.
//
// progress:   called from this thread with the bytes done and in all; may be null
// few_values: may be null; set to the counts of integers, in exact bins, if there are no more
//             different ones than volume::SuggestLabels takes
absl::StatusOr<ValueRange> FindValueRange(
    VolumeSource* source, const std::function<void(std::int64_t, std::int64_t)>& progress,
    const base::Cancellation& cancellation,
    std::optional<volume::SampleHistogram>* few_values = nullptr);

// The shortest number near the middle of a span that has a surface: above its least value, at most
// its largest. "" if no number is: the span is empty, or a single value.
std::string MiddleIsovalue(const volume::ScalarSpan& span);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_ADAPT_VALUE_RANGE_H_
