#include "core/source/sample_location.h"

namespace isoscope::source {

absl::StatusOr<SampleLocation> LocateSamples(FileFormat format, const std::string& path) {
  switch (format) {
    case FileFormat::kNifti:
      return LocateNiftiSamples(path);
    case FileFormat::kNrrd:
      return LocateNrrdSamples(path);
    case FileFormat::kMetaImage:
      return LocateMetaImageSamples(path);
  }
  return absl::InternalError("file format out of range");
}

}  // namespace isoscope::source
