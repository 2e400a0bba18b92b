// Tells NRRD and MetaImage files apart, and finds their samples.

#ifndef ISOSCOPE_CORE_FORMATS_MEDICAL_SAMPLE_FORMAT_H_
#define ISOSCOPE_CORE_FORMATS_MEDICAL_SAMPLE_FORMAT_H_

#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/bytes/sample_location.h"

namespace isoscope::source {

enum class FileFormat { kNrrd, kMetaImage };

// Reads the header of `path`. INVALID_ARGUMENT: not such a header; an encoding that is not
// supported; more or fewer data files than its sizes need. NOT_FOUND: a data file is missing.
absl::StatusOr<SampleLocation> LocateSamples(FileFormat format, const std::string& path);

absl::StatusOr<SampleLocation> LocateNrrdSamples(const std::string& path);
absl::StatusOr<SampleLocation> LocateMetaImageSamples(const std::string& path);

// Returns true if a name ends as those of NRRD (.nrrd .nhdr), or of MetaImage (.mha .mhd).
bool HasNrrdName(const std::string& path);
bool HasMetaImageName(const std::string& path);
// Returns true if the first bytes of a file are of one.
bool IsNrrdHeader(absl::string_view head);
bool IsMetaImageHeader(absl::string_view head);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_MEDICAL_SAMPLE_FORMAT_H_
