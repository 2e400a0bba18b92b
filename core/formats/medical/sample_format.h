// NRRD and MetaImage: which of them a file is, and where its samples lie.

#ifndef ISOSCOPE_CORE_FORMATS_MEDICAL_SAMPLE_FORMAT_H_
#define ISOSCOPE_CORE_FORMATS_MEDICAL_SAMPLE_FORMAT_H_

#include <optional>
#include <string>

#include "absl/status/statusor.h"

#include "core/source/bytes/sample_location.h"

namespace isoscope::source {

enum class FileFormat { kNrrd, kMetaImage };

// Reads the header of `path`. INVALID_ARGUMENT: not such a header; an encoding that is not
// supported; more or fewer data files than its sizes need. NOT_FOUND: a data file is missing.
absl::StatusOr<SampleLocation> LocateSamples(FileFormat format, const std::string& path);

absl::StatusOr<SampleLocation> LocateNrrdSamples(const std::string& path);
absl::StatusOr<SampleLocation> LocateMetaImageSamples(const std::string& path);

// The format of a file: by the ending of the name (NRRD: .nrrd .nhdr;
// MetaImage: .mha .mhd), else by the first bytes of an existing file. Not set for others.
std::optional<FileFormat> SampleFormatOf(const std::string& path);
// "nrrd", "metaimage", in any case; not set for other names.
std::optional<FileFormat> SampleFormatFromName(const std::string& name);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_MEDICAL_SAMPLE_FORMAT_H_
