// A volume whose samples lie at uneven distances, interpolated onto even ones: --resample.

#ifndef ISOSCOPE_CORE_SOURCE_ADAPT_RESAMPLED_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_ADAPT_RESAMPLED_SOURCE_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/grid/axis_distances.h"
#include "core/source/volume_source.h"

namespace isoscope::source {

// Even samples in place of uneven ones, the first and the last of which they keep.
struct EvenSamples {
  std::int64_t count = 0;
  double step = 0;
};
// The step is the smallest distance of neighbours, or a little less, so that a whole number of
// steps reaches the last sample. On average there are at most four steps for each distance of the
// source. REQUIRES: at least two distances, ascending from 0, finite.
EvenSamples EvenSamplesFor(const std::vector<double>& distances);

// Interpolates linearly along the uneven axes, x first, then y, then z, in double, rounded once.
// Integers of 8 and 16 bits become float32, wider ones float64. A sample that lies at one of the
// source, within a millionth of the gap, is that one. NaN with a share in a sample makes it NaN,
// and so does a sample of the value `fill`. Holds two planes of the source. Returns the source
// itself if all axes are even. INVALID_ARGUMENT: distances that do not ascend from 0, or are not
// one for each sample (names the axis and both); volume::Validate of the new grid.
absl::StatusOr<std::unique_ptr<VolumeSource>> ResampleSource(std::unique_ptr<VolumeSource> source,
                                                             AxisDistances distances,
                                                             std::optional<double> fill);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_ADAPT_RESAMPLED_SOURCE_H_
