// Two messages carry a histogram. The internal one (GetShardHistogramResponse) goes from an agent
// to the coordinator and back to a volume::HistogramPart. The public one goes from the coordinator
// to a client, in one direction only.
//
// A part from the wire is checked in this order: the limits of bins and groups, the lengths of the
// lists, and each count, which must lie in [0, 2^46].
//
// Invariant: no sum over agents can overflow, because of kMaxOfAgent.

#include "wire/histogram_convert.h"

#include <cstddef>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"

#include "core/base/status_macros.h"
#include "wire/enum_table.h"
#include "wire/known_fields.h"
#include "wire/proto_convert.h"

namespace isoscope::wire {
namespace {

namespace internal = isoscope::internal::v1;
namespace v1 = isoscope::v1;

constexpr std::int64_t kDefaultBinCount = 256;
constexpr std::int64_t kMaxFirstBin = std::int64_t{1} << 53;
// The largest count from one agent, of blocks, bytes or samples. With this limit, sums over all
// agents fit 63 bits.
constexpr std::int64_t kMaxOfAgent = std::int64_t{1} << 46;

// Both messages have the same fields.
template <typename Request>
absl::StatusOr<HistogramQuery> QueryOf(const Request& request) {
  const std::int32_t max_bin_count = request.max_bin_count();
  const v1::ValueRange& range = request.value_range();
  HistogramQuery query;
  if (max_bin_count < 0 || max_bin_count > volume::kMaxHistogramBins) {
    return absl::InvalidArgumentError(
        absl::StrFormat("max_bin_count is %d: must be in [1, %d], or 0 for the default of %d",
                        max_bin_count, volume::kMaxHistogramBins, kDefaultBinCount));
  }
  query.max_bin_count = max_bin_count == 0 ? kDefaultBinCount : max_bin_count;
  const std::int32_t max_values = request.max_label_value_count();
  if (max_values < 0 || static_cast<std::size_t>(max_values) > volume::kMaxListedValues) {
    return absl::InvalidArgumentError(
        absl::StrFormat("max_label_value_count is %d: must be in [1, %d], or 0 for none",
                        max_values, volume::kMaxListedValues));
  }
  query.max_label_value_count = static_cast<std::size_t>(max_values);
  if (request.has_value_range()) {
    ISOSCOPE_RETURN_IF_ERROR(CheckFinite(range.min(), "value_range.min"));
    ISOSCOPE_RETURN_IF_ERROR(CheckFinite(range.max(), "value_range.max"));
    if (range.min() > range.max()) {
      return absl::InvalidArgumentError(
          absl::StrFormat("value_range is %g to %g: min must be <= max", range.min(), range.max()));
    }
    query.value_range = volume::ScalarSpan{range.min(), range.max()};
  }
  return query;
}

// Takes `count` numbers in [0, kMaxOfAgent].
template <typename Repeated>
absl::StatusOr<std::vector<std::int64_t>> CountsFromProto(const Repeated& proto, std::int64_t count,
                                                          absl::string_view path) {
  if (static_cast<std::int64_t>(proto.size()) != count) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, " has ", proto.size(), " elements: must have ", count));
  }
  for (const std::int64_t element : proto) {
    if (element < 0 || element > kMaxOfAgent) {
      return absl::InvalidArgumentError(
          absl::StrCat(path, " has a ", element, ": must be in [0, 2^46]"));
    }
  }
  return std::vector<std::int64_t>(proto.begin(), proto.end());
}

absl::StatusOr<volume::SampleHistogram> SamplesFromProto(const internal::SampleCounts& proto,
                                                         const volume::HistogramBins& bins) {
  volume::SampleHistogram histogram;
  histogram.bins = bins;
  ISOSCOPE_ASSIGN_OR_RETURN(histogram.counts,
                            CountsFromProto(proto.counts(), bins.count, "samples.counts"));
  const std::vector<std::int64_t> apart{proto.nan_count(), proto.negative_infinity_count(),
                                        proto.positive_infinity_count()};
  ISOSCOPE_RETURN_IF_ERROR(CountsFromProto(apart, 3, "samples").status());
  histogram.nan_count = apart[0];
  histogram.negative_infinity_count = apart[1];
  histogram.positive_infinity_count = apart[2];
  if (histogram.TotalCount() > kMaxOfAgent) {
    return absl::InvalidArgumentError(
        absl::StrCat("samples has ", histogram.TotalCount(), " in all: must be at most 2^46"));
  }
  return histogram;
}

absl::StatusOr<volume::BinGroups> GroupsFromProto(
    const internal::GetShardHistogramResponse& proto) {
  volume::BinGroups groups;
  groups.bins = {.exponent = proto.bin_exponent(),
                 .first = proto.first_bin(),
                 .count = proto.stored_bin_count()};
  groups.begin = proto.group_begin();
  groups.size = proto.bins_per_group_count();
  groups.count = proto.active_block_counts_size();
  const bool is_valid =
      groups.bins.exponent >= volume::kMinHistogramExponent &&
      groups.bins.exponent <= volume::kMaxHistogramExponent && groups.bins.first >= -kMaxFirstBin &&
      groups.bins.first <= kMaxFirstBin && groups.bins.count >= 0 &&
      groups.bins.count <= volume::kMaxHistogramBins && groups.begin >= 0 &&
      groups.begin <= groups.bins.count && groups.size >= 1 &&
      groups.size <= volume::kMaxHistogramBins &&
      groups.count <= (groups.bins.count - groups.begin + groups.size - 1) / groups.size;
  if (!is_valid) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%d groups of %d bins from %d on, of %d bins of 2^%d from %d on: no such bins",
        groups.count, groups.size, groups.begin, groups.bins.count, groups.bins.exponent,
        groups.bins.first));
  }
  return groups;
}

template <typename Repeated>
void Assign(const std::vector<std::int64_t>& values, Repeated* repeated) {
  repeated->Assign(values.begin(), values.end());
}

constexpr EnumRow<volume::SuggestionMethod, v1::IsovalueSuggestion::Method> kMethods[] = {
    {volume::SuggestionMethod::kBetweenClasses, v1::IsovalueSuggestion::METHOD_BETWEEN_CLASSES},
    {volume::SuggestionMethod::kOnePercent, v1::IsovalueSuggestion::METHOD_ONE_PERCENT}};

// A box of cells that an agent found.
absl::StatusOr<std::optional<math::IndexBox>> CellsFromProto(const v1::Dimensions& begin,
                                                             const v1::Dimensions& end,
                                                             const volume::BlockLayout& layout) {
  const math::IndexBox box{{begin.x(), begin.y(), begin.z()}, {end.x(), end.y(), end.z()}};
  for (int axis = 0; axis < 3; ++axis) {
    if (box.begin[axis] < 0 || box.end[axis] <= box.begin[axis] ||
        box.end[axis] >= layout.sample_dims()[axis]) {
      return absl::InvalidArgumentError(
          absl::StrFormat("cells %d to %d on axis %d: must ascend and lie in [0, %d)",
                          box.begin[axis], box.end[axis], axis, layout.sample_dims()[axis]));
    }
  }
  return box;
}

}  // namespace

absl::StatusOr<HistogramQuery> HistogramQueryFromProto(const v1::GetHistogramRequest& request) {
  ISOSCOPE_RETURN_IF_ERROR(CheckKnownFields(request));
  return QueryOf(request);
}

absl::StatusOr<HistogramQuery> HistogramQueryFromProto(
    const internal::GetShardHistogramRequest& request) {
  ISOSCOPE_RETURN_IF_ERROR(CheckKnownFields(request));
  return QueryOf(request);
}

v1::LabelValues ToProto(const volume::LabelValues& values) {
  v1::LabelValues proto;
  proto.mutable_values()->Assign(values.values().begin(), values.values().end());
  proto.set_has_more(values.has_more());
  if (values.other_value().has_value()) {
    proto.set_other_value(*values.other_value());
  }
  return proto;
}

absl::StatusOr<volume::LabelValues> LabelValuesFromProto(const v1::LabelValues& proto) {
  if (static_cast<std::size_t>(proto.values_size()) > volume::kMaxListedValues) {
    return absl::InvalidArgumentError(
        absl::StrFormat("label_values.values has %d, must be at most %d", proto.values_size(),
                        volume::kMaxListedValues));
  }
  for (int i = 0; i < proto.values_size(); ++i) {
    const double value = proto.values(i);
    if (!volume::MayBeLabel(value) || (i > 0 && !(proto.values(i - 1) < value))) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "label_values.values[%d] is %g: must be ascending whole numbers", i, value));
    }
  }
  return volume::LabelValues::Of(
      {proto.values().begin(), proto.values().end()}, proto.has_more(),
      proto.has_other_value() ? std::optional<double>(proto.other_value()) : std::nullopt);
}

internal::GetShardHistogramResponse ToProto(const volume::HistogramPart& part) {
  internal::GetShardHistogramResponse proto;
  const volume::BinGroups& groups = part.groups;
  proto.set_bin_exponent(groups.bins.exponent);
  proto.set_first_bin(groups.bins.first);
  proto.set_stored_bin_count(static_cast<std::int32_t>(groups.bins.count));
  proto.set_group_begin(static_cast<std::int32_t>(groups.begin));
  proto.set_bins_per_group_count(static_cast<std::int32_t>(groups.size));
  Assign(part.active_block_counts, proto.mutable_active_block_counts());
  Assign(part.active_block_bytes, proto.mutable_active_block_bytes());
  Assign(part.estimated_triangle_counts, proto.mutable_estimated_triangle_counts());
  if (part.value_range.min <= part.value_range.max) {
    proto.mutable_value_range()->set_min(part.value_range.min);
    proto.mutable_value_range()->set_max(part.value_range.max);
  }
  if (part.samples.has_value()) {
    internal::SampleCounts* samples = proto.mutable_samples();
    Assign(part.samples->counts, samples->mutable_counts());
    samples->set_nan_count(part.samples->nan_count);
    samples->set_negative_infinity_count(part.samples->negative_infinity_count);
    samples->set_positive_infinity_count(part.samples->positive_infinity_count);
  }
  if (part.label_values.has_value()) {
    *proto.mutable_label_values() = ToProto(*part.label_values);
  }
  return proto;
}

absl::StatusOr<volume::HistogramPart> HistogramPartFromProto(
    const internal::GetShardHistogramResponse& proto) {
  volume::HistogramPart part;
  ISOSCOPE_ASSIGN_OR_RETURN(part.groups, GroupsFromProto(proto));
  const std::int64_t count = part.groups.count;
  ISOSCOPE_ASSIGN_OR_RETURN(
      part.active_block_counts,
      CountsFromProto(proto.active_block_counts(), count, "active_block_counts"));
  ISOSCOPE_ASSIGN_OR_RETURN(part.active_block_bytes, CountsFromProto(proto.active_block_bytes(),
                                                                     count, "active_block_bytes"));
  ISOSCOPE_ASSIGN_OR_RETURN(
      part.estimated_triangle_counts,
      CountsFromProto(proto.estimated_triangle_counts(), count, "estimated_triangle_counts"));
  if (proto.has_value_range()) {
    part.value_range = {proto.value_range().min(), proto.value_range().max()};
    if (!(part.value_range.min <= part.value_range.max)) {
      return absl::InvalidArgumentError(
          absl::StrFormat("value_range is %g to %g: min must be <= max", part.value_range.min,
                          part.value_range.max));
    }
  }
  if (proto.has_samples()) {
    ISOSCOPE_ASSIGN_OR_RETURN(part.samples, SamplesFromProto(proto.samples(), part.groups.bins));
  }
  if (proto.has_label_values()) {
    ISOSCOPE_ASSIGN_OR_RETURN(part.label_values, LabelValuesFromProto(proto.label_values()));
  }
  return part;
}

v1::GetHistogramResponse ToProto(const volume::HistogramPart& whole,
                                 const std::vector<volume::IsovalueSuggestion>& suggestions,
                                 const std::vector<double>& labels) {
  v1::GetHistogramResponse response;
  if (whole.label_values.has_value()) {
    *response.mutable_label_values() = ToProto(*whole.label_values);
  }
  const volume::BinGroups& groups = whole.groups;
  for (std::int64_t g = 0; g < groups.count; ++g) {
    const auto at = static_cast<std::size_t>(g);
    v1::HistogramBin* bin = response.add_bins();
    bin->set_min(groups.LowerEdgeOf(g));
    bin->set_max(groups.LowerEdgeOf(g + 1));
    bin->set_active_block_count(whole.active_block_counts[at]);
    bin->set_active_block_bytes(whole.active_block_bytes[at]);
    bin->set_estimated_triangle_count(whole.estimated_triangle_counts[at]);
    if (whole.samples.has_value()) {
      bin->set_sample_count(groups.SumOf(whole.samples->counts, g));
    }
  }
  if (whole.samples.has_value()) {
    response.set_has_sample_counts(true);
    response.set_nan_count(whole.samples->nan_count);
    response.set_negative_infinity_count(whole.samples->negative_infinity_count);
    response.set_positive_infinity_count(whole.samples->positive_infinity_count);
  }
  for (const volume::IsovalueSuggestion& suggestion : suggestions) {
    v1::IsovalueSuggestion* proto = response.add_suggestions();
    proto->set_method(EnumToProto(kMethods, suggestion.method));
    proto->set_isovalue(suggestion.isovalue);
    proto->set_inside_fraction(suggestion.inside_fraction);
  }
  response.mutable_suggested_labels()->Assign(labels.begin(), labels.end());
  return response;
}

internal::GetActiveBoxResponse ToProto(std::int64_t active_block_count,
                                       const math::IndexBox& cells) {
  internal::GetActiveBoxResponse proto;
  proto.set_active_block_count(active_block_count);
  if (active_block_count > 0) {
    *proto.mutable_begin_cell() = ToProto(cells.begin);
    *proto.mutable_end_cell() = ToProto(cells.end);
  }
  return proto;
}

absl::StatusOr<std::optional<math::IndexBox>> ActiveBoxFromProto(
    const internal::GetActiveBoxResponse& proto, const volume::BlockLayout& layout) {
  if (proto.active_block_count() == 0) {
    return std::nullopt;
  }
  return CellsFromProto(proto.begin_cell(), proto.end_cell(), layout);
}

internal::GetCellBoxResponse ToProto(const math::IndexBox& cells) {
  internal::GetCellBoxResponse proto;
  if (!cells.empty()) {
    *proto.mutable_begin_cell() = ToProto(cells.begin);
    *proto.mutable_end_cell() = ToProto(cells.end);
  }
  return proto;
}

absl::StatusOr<std::optional<math::IndexBox>> CellBoxFromProto(
    const internal::GetCellBoxResponse& proto, const volume::BlockLayout& layout) {
  if (!proto.has_begin_cell() && !proto.has_end_cell()) {
    return std::nullopt;
  }
  return CellsFromProto(proto.begin_cell(), proto.end_cell(), layout);
}

}  // namespace isoscope::wire
