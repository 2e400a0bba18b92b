// A series of fields whose samples lie at known places of files: what our own readers of headers
// make.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_LOCATED_SERIES_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_LOCATED_SERIES_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <variant>
#include <vector>

#include "core/source/adapt/resampled_source.h"
#include "core/source/adapt/wide_source.h"
#include "core/source/bytes/sample_location.h"
#include "core/source/bytes/text_source.h"
#include "core/source/grid/axis_distances.h"
#include "core/source/volume_series.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::source {

// The location of the samples of a field.
struct FieldLocation {
  // The component is that of a tuple; the volume of a SampleLocation is the step.
  std::variant<SampleLocation, TextLocation> location;
  std::optional<WideType> wide{};  // of a SampleLocation, whose stored type is its carrier
};

struct LocatedFile {
  SeriesInfo info{};
  volume::GridGeometry geometry{};
  AxisDistances distances{};               // of a grid that is not even, which is resampled then
  std::optional<double> fill{};            // the value of holes, if it is
  std::vector<FieldLocation> locations{};  // by field

  void Add(SourceField field, FieldLocation location) {
    info.fields.push_back(std::move(field));
    locations.push_back(std::move(location));
  }
};

// REQUIRES: at least one field.
std::unique_ptr<VolumeSeries> MakeLocatedSeries(LocatedFile file);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_LOCATED_SERIES_H_
