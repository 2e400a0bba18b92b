// Converts the ranges of colour maps, and finds those that a request leaves to the dataset. All
// errors are INVALID_ARGUMENT; they name the field, its value and the allowed values. `path` is the
// field's name in messages.

#ifndef ISOSCOPE_WIRE_COLOR_RANGE_CONVERT_H_
#define ISOSCOPE_WIRE_COLOR_RANGE_CONVERT_H_

#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/frame/appearance.h"
#include "core/frame/frame_spec.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::wire {

// A range as a request says it: numbers, or where they come from.
struct AskedRange {
  std::optional<frame::ColorRange> range = std::nullopt;
  frame::RangeSource source = frame::RangeSource::kAllSteps;
  std::optional<frame::Percentiles> percentiles = std::nullopt;
};
absl::StatusOr<AskedRange> AskedRangeFromProto(const isoscope::v1::ColorRange& proto,
                                               const std::string& path);
// Not set: the default. A range with numbers has no source.
std::optional<isoscope::v1::ColorRange> ToProto(const AskedRange& asked);

// INVALID_ARGUMENT if a frame with a region has a range of what is visible: the colours of a region
// are those of the whole.
absl::Status CheckRangesOfRegion(const frame::FrameSpec& spec);
// Whether a range is that of what is visible, and not known yet.
bool HasVisibleRanges(const frame::FrameSpec& spec);

// Returns the range of a map over the finite samples of a component; 0 to 1 if all are NaN.
// INVALID_ARGUMENT if the component does not tell it; `path` is that of the range.
absl::StatusOr<frame::ColorRange> ColorRangeOf(const isoscope::v1::FieldComponent& component,
                                               const std::string& path);

// Gives the maps that show the gradient's magnitude, and the map of caps, a range where the frame
// has none: 0 to the bound, and that of the finite samples. Ranges of what is visible get that of
// all steps first, and keep their source. Leaves out percentiles. INVALID_ARGUMENT if the dataset
// does not tell it.
//
// dataset: the volume that is drawn, with ranges over all steps
// at_step: its ranges at the step that is drawn
absl::Status ResolveColorRanges(const isoscope::v1::Dataset& dataset,
                                const isoscope::v1::FieldComponent& at_step,
                                frame::FrameSpec* spec);

// Returns the ranges of a dataset of one volume.
isoscope::v1::FieldComponent RangesOf(const isoscope::v1::Dataset& dataset);

}  // namespace isoscope::wire

#endif  // ISOSCOPE_WIRE_COLOR_RANGE_CONVERT_H_
