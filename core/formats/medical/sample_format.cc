#include "core/formats/medical/sample_format.h"

#include <array>

#include "absl/strings/match.h"

#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/source/bytes/file_start.h"

namespace isoscope::source {

std::optional<FileFormat> SampleFormatOf(const std::string& path) {
  struct SampleEnding {
    const char* text;
    FileFormat format;
  };
  constexpr std::array<SampleEnding, 4> kEndings{{{".nrrd", FileFormat::kNrrd},
                                                  {".nhdr", FileFormat::kNrrd},
                                                  {".mha", FileFormat::kMetaImage},
                                                  {".mhd", FileFormat::kMetaImage}}};
  for (const SampleEnding& ending : kEndings) {
    if (absl::EndsWithIgnoreCase(path, ending.text)) {
      return ending.format;
    }
  }
  constexpr std::size_t kHeadBytes = 64;
  const auto head = ReadFileStart(path, kHeadBytes);
  if (!head.ok() || head->is_gzip) {
    return std::nullopt;
  }
  if (absl::StartsWith(head->bytes, "NRRD000")) {
    return FileFormat::kNrrd;
  }
  if (absl::StartsWith(head->bytes, "ObjectType") || absl::StartsWith(head->bytes, "NDims")) {
    return FileFormat::kMetaImage;
  }
  return std::nullopt;
}

std::optional<FileFormat> SampleFormatFromName(const std::string& name) {
  struct Name {
    const char* text;
    FileFormat format;
  };
  constexpr std::array<Name, 2> kNames{
      {{"nrrd", FileFormat::kNrrd}, {"metaimage", FileFormat::kMetaImage}}};
  for (const Name& known : kNames) {
    if (absl::EqualsIgnoreCase(name, known.text)) {
      return known.format;
    }
  }
  return std::nullopt;
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
