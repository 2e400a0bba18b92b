// Volumes of a series whose samples are in their source.

#ifndef ISOSCOPE_CORE_STORE_SOURCE_VOLUME_H_
#define ISOSCOPE_CORE_STORE_SOURCE_VOLUME_H_

#include <optional>
#include <string>

#include "absl/status/statusor.h"

#include "core/store/sample_reader.h"
#include "core/store/series_manifest.h"

namespace isoscope::store {

// Members of SourceSamples::request of a volume of a series, which tell it among those that the source
// has (core/indexed/source_request.h).
inline constexpr char kFieldMember[] = "volume_field";  // its name
inline constexpr char kComponentMember[] =
    "volume_component";                               // its number; behind the last: magnitude
inline constexpr char kStepMember[] = "volume_step";  // its number

// Returns where the samples of a volume are, by its manifest in the folder of a shard of the series; not
// set: in the shard. NOT_FOUND, DATA_LOSS, FAILED_PRECONDITION of the manifest.
absl::StatusOr<std::optional<SourceSamples>> SamplesOfVolume(const std::string& shard_directory,
                                                             const ScalarVolumeKey& key);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_SOURCE_VOLUME_H_
