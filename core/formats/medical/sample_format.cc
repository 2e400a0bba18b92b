#include "core/formats/medical/sample_format.h"

#include "absl/strings/match.h"

#include "core/base/status_macros.h"
#include "core/io/file.h"

namespace isoscope::source {

bool HasNrrdName(const std::string& path) {
  return absl::EndsWithIgnoreCase(path, ".nrrd") || absl::EndsWithIgnoreCase(path, ".nhdr");
}

bool HasMetaImageName(const std::string& path) {
  return absl::EndsWithIgnoreCase(path, ".mha") || absl::EndsWithIgnoreCase(path, ".mhd");
}

bool IsNrrdHeader(absl::string_view head) { return absl::StartsWith(head, "NRRD000"); }

bool IsMetaImageHeader(absl::string_view head) {
  return absl::StartsWith(head, "ObjectType") || absl::StartsWith(head, "NDims");
}

namespace {

absl::StatusOr<SampleLocation> Locate(FileFormat format, const std::string& path) {
  switch (format) {
    case FileFormat::kNrrd:
      return LocateNrrdSamples(path);
    case FileFormat::kMetaImage:
      return LocateMetaImageSamples(path);
  }
  return absl::InternalError("file format out of range");
}

}  // namespace

absl::StatusOr<SampleLocation> LocateSamples(FileFormat format, const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(SampleLocation location, Locate(format, path));
  for (const std::string& file : location.files) {
    ISOSCOPE_RETURN_IF_ERROR(io::CheckIsRegularFile(file));
  }
  return location;
}

}  // namespace isoscope::source
