// A series of a single volume.

#ifndef ISOSCOPE_CORE_SOURCE_SINGLE_SERIES_H_
#define ISOSCOPE_CORE_SOURCE_SINGLE_SERIES_H_

#include <functional>
#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "core/source/volume_series.h"
#include "core/source/volume_source.h"

namespace isoscope::source {

struct SingleVolume {
  std::string path;  // for messages
  std::string field;
  std::string length_unit{};
  // The result of `open`; the first VolumeSeries::Open takes it.
  std::unique_ptr<VolumeSource> volume{};
  std::function<absl::StatusOr<std::unique_ptr<VolumeSource>>()> open{};
};

// The series of one field of one component, and one step without a time. Each further
// VolumeSeries::Open calls `open`, whose errors it has. REQUIRES: both are set.
std::unique_ptr<VolumeSeries> MakeSingleSeries(SingleVolume single);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_SINGLE_SERIES_H_
