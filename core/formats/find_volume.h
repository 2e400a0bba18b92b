// What a path names: by its name and by the content of the file, in one order for all who ask.

#ifndef ISOSCOPE_CORE_FORMATS_FIND_VOLUME_H_
#define ISOSCOPE_CORE_FORMATS_FIND_VOLUME_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/formats/format_table.h"
#include "core/formats/medical/sample_format.h"

namespace isoscope::source {

enum class SourceKind {
  kTiff,         // a stack of TIFF files
  kImageSlices,  // a stack of other pictures
  kHdf5,         // a dataset or the meshes of a file, or of a pattern
  kDicom,        // a series of a folder, or that of a file
  kVtkImage,     // a .vti or .pvti
  kPvd,          // a collection of VTK images
  kFormatFile,   // a file of a format of the table
  kSampleFile,   // NRRD or MetaImage
};

struct FoundVolume {
  SourceKind kind = SourceKind::kSampleFile;
  // TIFF: slices from the lowest up; kSampleFile: the header; kDicom, kPvd: none, since each
  // file of the folder, or the collection, would be opened.
  std::vector<std::string> files{};
  FormatFile format_file{};                      // of a kFormatFile
  FileFormat sample_format = FileFormat::kNrrd;  // of a kSampleFile

  // Whether the source names its fields.
  [[nodiscard]] bool has_field_names() const;
};

// NOT_FOUND: nothing there. INVALID_ARGUMENT: unknown kind of file (lists those known, and says how
// to read it as raw); a format that does not exist; a folder without a volume, or with several
// kinds. FAILED_PRECONDITION: a pipe or a device. `format` forces one of those that FormatNames
// lists; "": name and content decide.
absl::StatusOr<FoundVolume> FindVolume(const std::string& path, const std::string& format = "");

// Whether the path names a DICOM series: a folder that holds one and no TIFF files, or a file of
// it.
bool NamesDicomSeries(const std::string& path);

// A format of sources, as --list-formats has it.
struct FormatName {
  std::string name;   // "nrrd"
  std::string files;  // names of its files, for people: ".nrrd .nhdr"
  bool is_forceable =
      true;  // else the name must say it, because a path can name a part of the file
};
std::vector<FormatName> FormatNames();

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_FIND_VOLUME_H_
