#include "wire/color_range_convert.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"
#include "wire/enum_table.h"
#include "wire/proto_convert.h"

namespace isoscope::wire {
namespace {

namespace v1 = isoscope::v1;
using frame::RangeSource;

constexpr EnumRow<RangeSource, v1::ColorRange::Source> kSources[] = {
    {RangeSource::kAllSteps, v1::ColorRange::SOURCE_UNSPECIFIED},
    {RangeSource::kStep, v1::ColorRange::SOURCE_STEP},
    {RangeSource::kVisible, v1::ColorRange::SOURCE_VISIBLE}};

absl::StatusOr<frame::Percentiles> PercentilesFromProto(const v1::Percentiles& proto,
                                                        const std::string& path) {
  // Comparisons are false for NaN.
  if (!(proto.low() >= 0 && proto.low() < 100)) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ".low is ", proto.low(), ": must lie in [0, 100)"));
  }
  if (!(proto.high() > proto.low() && proto.high() <= 100)) {
    return absl::InvalidArgumentError(absl::StrCat(path, ".high is ", proto.high(),
                                                   ": must lie in (", proto.low(), ", 100], above ",
                                                   path, ".low"));
  }
  return frame::Percentiles{.low = proto.low(), .high = proto.high()};
}

absl::StatusOr<frame::ColorRange> EndsFromProto(const v1::ColorRange& proto,
                                                const std::string& path) {
  ISOSCOPE_RETURN_IF_ERROR(CheckFinite(proto.min(), absl::StrCat(path, ".min")));
  ISOSCOPE_RETURN_IF_ERROR(CheckFinite(proto.max(), absl::StrCat(path, ".max")));
  if (!(proto.max() > proto.min()) || !std::isfinite(proto.max() - proto.min())) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ".max is ", proto.max(), ": must be greater than ", path,
                     ".min, which is ", proto.min(), ", by a number that is finite"));
  }
  return frame::ColorRange{.min = proto.min(), .max = proto.max()};
}

// The range of a map over samples of these ranges (v1::Dataset, v1::FieldComponent).
template <typename Samples>
absl::StatusOr<frame::ColorRange> RangeOfSamples(const Samples& samples, const std::string& path) {
  if (!samples.has_value_range()) {
    return frame::ColorRange();
  }
  const v1::ValueRange& values =
      samples.has_finite_range() ? samples.finite_range() : samples.value_range();
  if (!std::isfinite(values.min()) || !std::isfinite(values.max())) {
    return absl::InvalidArgumentError(absl::StrCat(
        path,
        " is not set: required, because there are infinite samples, and the dataset does not "
        "tell the range of the finite ones; give the range (MAP:MIN,MAX), or partition the "
        "volume anew"));
  }
  return frame::ColorRangeOfSamples(values.min(), values.max());
}

// The range of the map of a surface that shows the gradient (v1::Dataset, v1::FieldComponent).
template <typename Samples>
absl::StatusOr<frame::ColorRange> GradientRangeOf(const Samples& samples, const std::string& name,
                                                  const std::string& path) {
  if (!samples.has_max_gradient_magnitude()) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ".range is not set: required, because dataset '", name,
        "' was partitioned by a version that did not store max_gradient_magnitude; give the "
        "range (--color-by gradient:MAP:MIN,MAX), or partition the volume anew"));
  }
  // A field that is constant has no surface; its map still needs a range.
  const double max = samples.max_gradient_magnitude();
  return frame::ColorRange{.min = 0, .max = max > 0 ? max : 1};
}

}  // namespace

absl::StatusOr<AskedRange> AskedRangeFromProto(const v1::ColorRange& proto,
                                               const std::string& path) {
  AskedRange asked;
  ISOSCOPE_ASSIGN_OR_RETURN(asked.source,
                            EnumFromProto(kSources, proto.source(), absl::StrCat(path, ".source"),
                                          "must be 0 (min and max), 1 (step) or 2 (visible)"));
  const bool has_source = proto.source() != v1::ColorRange::SOURCE_UNSPECIFIED;
  if (!has_source && !proto.has_percentiles()) {
    ISOSCOPE_ASSIGN_OR_RETURN(asked.range, EndsFromProto(proto, path));
    return asked;
  }
  const std::string why = has_source
                              ? absl::StrCat(path, ".source ", static_cast<int>(proto.source()))
                              : absl::StrCat(path, ".percentiles");
  if (proto.min() != 0 || proto.max() != 0) {
    return absl::InvalidArgumentError(absl::StrCat(path, proto.max() != 0 ? ".max is " : ".min is ",
                                                   proto.max() != 0 ? proto.max() : proto.min(),
                                                   " beside ", why,
                                                   ", which finds both ends: must be unset"));
  }
  if (proto.has_percentiles()) {
    if (has_source) {
      return absl::InvalidArgumentError(
          absl::StrCat(path, ".percentiles is set beside ", why, ": must be unset"));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(
        asked.percentiles,
        PercentilesFromProto(proto.percentiles(), absl::StrCat(path, ".percentiles")));
  }
  return asked;
}

std::optional<v1::ColorRange> ToProto(const AskedRange& asked) {
  v1::ColorRange proto;
  if (asked.range.has_value()) {
    proto.set_min(asked.range->min);
    proto.set_max(asked.range->max);
  } else if (asked.source != RangeSource::kAllSteps) {
    proto.set_source(EnumToProto(kSources, asked.source));
  } else if (asked.percentiles.has_value()) {
    proto.mutable_percentiles()->set_low(asked.percentiles->low);
    proto.mutable_percentiles()->set_high(asked.percentiles->high);
  } else {
    return std::nullopt;
  }
  return proto;
}

bool HasVisibleRanges(const frame::FrameSpec& spec) {
  return (frame::HasSampleCaps(spec) && spec.caps->range_source == RangeSource::kVisible) ||
         std::any_of(spec.surfaces.begin(), spec.surfaces.end(), [](const frame::Surface& surface) {
           return surface.color_by.has_value() &&
                  surface.color_by->range_source == RangeSource::kVisible;
         });
}

absl::Status CheckRangesOfRegion(const frame::FrameSpec& spec) {
  if (!spec.region.has_value() || !HasVisibleRanges(spec)) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(
      "region is set beside a range with source 2 (visible): must be unset, because a region has "
      "the colours of the whole picture; ask for the whole, and give the range that its answer "
      "has");
}

absl::StatusOr<frame::ColorRange> ColorRangeOf(const v1::FieldComponent& component,
                                               const std::string& path) {
  return RangeOfSamples(component, path);
}

absl::Status ResolveColorRanges(const v1::Dataset& dataset, const v1::FieldComponent& at_step,
                                frame::FrameSpec* spec) {
  for (std::size_t i = 0; i < spec->surfaces.size(); ++i) {
    frame::Surface& surface = spec->surfaces[i];
    if (!surface.shows_gradient() || surface.color_by->range.has_value()) {
      continue;
    }
    const std::string path = absl::StrCat("surfaces[", i, "].color_by");
    if (surface.color_by->range_source == RangeSource::kStep) {
      ISOSCOPE_ASSIGN_OR_RETURN(surface.color_by->range,
                                GradientRangeOf(at_step, dataset.name(), path));
    } else {
      ISOSCOPE_ASSIGN_OR_RETURN(surface.color_by->range,
                                GradientRangeOf(dataset, dataset.name(), path));
    }
  }
  if (!frame::HasSampleCaps(*spec) || spec->caps->range.has_value() ||
      spec->caps->percentiles.has_value()) {
    return absl::OkStatus();
  }
  if (spec->caps->range_source == RangeSource::kStep) {
    ISOSCOPE_ASSIGN_OR_RETURN(spec->caps->range, RangeOfSamples(at_step, "caps.range"));
  } else {
    ISOSCOPE_ASSIGN_OR_RETURN(spec->caps->range, RangeOfSamples(dataset, "caps.range"));
  }
  return absl::OkStatus();
}

v1::FieldComponent RangesOf(const v1::Dataset& dataset) {
  v1::FieldComponent ranges;
  ranges.set_sample_type(dataset.sample_type());
  if (dataset.has_value_range()) {
    *ranges.mutable_value_range() = dataset.value_range();
  }
  if (dataset.has_finite_range()) {
    *ranges.mutable_finite_range() = dataset.finite_range();
  }
  if (dataset.has_max_gradient_magnitude()) {
    ranges.set_max_gradient_magnitude(dataset.max_gradient_magnitude());
  }
  return ranges;
}

}  // namespace isoscope::wire
