// Converts histograms between messages and core types.

#ifndef ISOSCOPE_WIRE_HISTOGRAM_CONVERT_H_
#define ISOSCOPE_WIRE_HISTOGRAM_CONVERT_H_

#include <cstdint>
#include <optional>
#include <vector>

#include "absl/status/statusor.h"

#include "core/math/box.h"
#include "core/volume/block_layout.h"
#include "core/volume/isovalue_suggestions.h"
#include "core/volume/sample_histogram.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "isoscope/v1/dataset_service.pb.h"

namespace isoscope::wire {

// The parameters of a request.
struct HistogramQuery {
  std::int64_t max_bin_count = 256;               // 1 to kMaxHistogramBins
  std::optional<volume::ScalarSpan> value_range;  // finite, min <= max
  std::size_t max_label_value_count = 0;          // at most kMaxListedValues; 0: none are wanted
};

// All From functions: INVALID_ARGUMENT names the field, its value and the allowed ones.
absl::StatusOr<HistogramQuery> HistogramQueryFromProto(
    const isoscope::v1::GetHistogramRequest& request);
absl::StatusOr<HistogramQuery> HistogramQueryFromProto(
    const isoscope::internal::v1::GetShardHistogramRequest& request);

isoscope::internal::v1::GetShardHistogramResponse ToProto(const volume::HistogramPart& part);
absl::StatusOr<volume::HistogramPart> HistogramPartFromProto(
    const isoscope::internal::v1::GetShardHistogramResponse& proto);

// Fills the answer for clients.
//
// whole:  the sum of all parts
// labels: those that are suggested
isoscope::v1::GetHistogramResponse ToProto(
    const volume::HistogramPart& whole, const std::vector<volume::IsovalueSuggestion>& suggestions,
    const std::vector<double>& labels = {});

// The cells of the box of the active blocks; not set if there are none.
isoscope::internal::v1::GetActiveBoxResponse ToProto(std::int64_t active_block_count,
                                                     const math::IndexBox& cells);
absl::StatusOr<std::optional<math::IndexBox>> ActiveBoxFromProto(
    const isoscope::internal::v1::GetActiveBoxResponse& proto, const volume::BlockLayout& layout);
// The box of the active cells; empty or not set if there are none.
isoscope::internal::v1::GetCellBoxResponse ToProto(const math::IndexBox& cells);
absl::StatusOr<std::optional<math::IndexBox>> CellBoxFromProto(
    const isoscope::internal::v1::GetCellBoxResponse& proto, const volume::BlockLayout& layout);

}  // namespace isoscope::wire

#endif  // ISOSCOPE_WIRE_HISTOGRAM_CONVERT_H_
