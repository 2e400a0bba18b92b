// A series in the messages: its fields, steps and scalar volumes.

#ifndef ISOSCOPE_WIRE_SERIES_CONVERT_H_
#define ISOSCOPE_WIRE_SERIES_CONVERT_H_

#include <vector>

#include "core/store/series_manifest.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "isoscope/v1/dataset.pb.h"

namespace isoscope::wire {

// Returns a series as its manifest describes it: all steps, and ranges over all volumes.
isoscope::v1::Dataset ToProto(const store::SeriesManifest& manifest);

isoscope::internal::v1::VolumeDescription ToProto(const store::ScalarVolume& volume);
// Takes indices as they are.
store::ScalarVolumeKey KeyOf(const isoscope::internal::v1::VolumeDescription& volume);

}  // namespace isoscope::wire

#endif  // ISOSCOPE_WIRE_SERIES_CONVERT_H_
