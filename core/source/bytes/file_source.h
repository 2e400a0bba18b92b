// A source that streams samples from one file, or from several in turn.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_FILE_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_FILE_SOURCE_H_

#include <memory>
#include <optional>
#include <string>

#include "absl/status/statusor.h"

#include "core/source/bytes/sample_location.h"
#include "core/source/volume_source.h"

namespace isoscope::source {

// Opens the samples at `location` as a volume of `geometry`; `name` is for messages. With a slope
// or an intercept the samples become float32, those of 32-bit integers and float64 become float64.
// INVALID_ARGUMENT if an uncompressed file is too short (names it and both sizes), or the files
// can't hold as many samples each; longer files are accepted with a warning in the log. The length
// of a compressed file is known only after reading it; it is read from its start up to the volume
// that is wanted. Memory: a third of a MiB, and one open file, however many there are; 64 KiB of
// tuples if there are several components.
absl::StatusOr<std::unique_ptr<VolumeSource>> MakeFileSource(
    const volume::GridGeometry& geometry, const SampleLocation& location, const std::string& name,
    const std::optional<volume::PatientFrame>& patient_frame = std::nullopt);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_FILE_SOURCE_H_
