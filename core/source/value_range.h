// The range of a volume's values, without cutting it into blocks.

#ifndef ISOSCOPE_CORE_SOURCE_VALUE_RANGE_H_
#define ISOSCOPE_CORE_SOURCE_VALUE_RANGE_H_

#include <cstdint>
#include <functional>

#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/source/volume_source.h"
#include "core/volume/scalar_span.h"

namespace isoscope::source {

// The span of all samples, NaN left out: what Partition writes as the manifest's value_range. Reads
// the volume once, in portions of at most 8 MiB (or one row). `progress` is called from this thread
// with the bytes done and in all; it may be null. Errors as ReadRows; CANCELLED.
absl::StatusOr<volume::ScalarSpan> FindValueRange(
    VolumeSource* source, const std::function<void(std::int64_t, std::int64_t)>& progress,
    const base::Cancellation& cancellation);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_VALUE_RANGE_H_
