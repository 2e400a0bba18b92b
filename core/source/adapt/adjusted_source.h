// A part of a volume, with holes in place of one of its values.

#ifndef ISOSCOPE_CORE_SOURCE_ADAPT_ADJUSTED_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_ADAPT_ADJUSTED_SOURCE_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/math/vec.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"

namespace isoscope::source {

// Samples begin to end - 1 on each axis.
struct SampleBox {
  math::Index3 begin;
  math::Index3 end;

  friend bool operator==(const SampleBox&, const SampleBox&) = default;
};
// "X0:X1,Y0:Y1,Z0:Z1", each X0 up to X1 - 1; without a number: from the first, or to the last
// sample. INVALID_ARGUMENT quotes the text. `end` is the largest integer where none is given.
absl::StatusOr<SampleBox> ParseSampleBox(absl::string_view text);

struct Adjustment {
  std::optional<SampleBox> crop{};
  // Takes each stride-th sample on each axis, from the first one of the box on. It takes no mean,
  // so isovalues and labels keep their meaning.
  std::int64_t stride = 1;
  // Samples of this value become NaN. Integers of 8 and 16 bits become float32, wider ones float64.
  std::optional<double> fill{};
  // Axes that do not meet at right angles get the nearest ones (straight_grid.h).
  bool ignores_shear = false;

  [[nodiscard]] bool is_none() const {
    return !crop.has_value() && stride == 1 && !fill && !ignores_shear;
  }
};

// Samples keep their world positions, unless a shear is ignored: the origin moves to the first one
// that is left, and the spacing grows with the stride. A source that is_resampled has its holes
// already, and is not filled again. Reads in runs of at most 4 MiB, or one row, which it holds.
// INVALID_ARGUMENT: the box does not lie in the volume; fewer than two samples are left on an axis.
absl::StatusOr<std::unique_ptr<VolumeSource>> AdjustSource(std::unique_ptr<VolumeSource> source,
                                                           const Adjustment& adjustment);
// Does so with each volume that is opened. Errors of Open: as AdjustSource.
std::unique_ptr<VolumeSeries> AdjustSeries(std::unique_ptr<VolumeSeries> series,
                                           const Adjustment& adjustment);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_ADAPT_ADJUSTED_SOURCE_H_
