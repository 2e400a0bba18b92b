// The DICOM series in a folder: which there are, and which files make one.

#ifndef ISOSCOPE_CORE_FORMATS_DICOM_DICOM_FOLDER_H_
#define ISOSCOPE_CORE_FORMATS_DICOM_DICOM_FOLDER_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/formats/dicom/dicom_decoder.h"
#include "core/formats/dicom/dicom_scan.h"
#include "core/source/series_entry.h"

namespace isoscope::source {

// True if the file begins as DICOM files do (dicom_scan.h).
bool IsDicomFile(const std::string& path);
// True if the file is the index of a medium, as those named DICOMDIR are: it names its folder.
bool IsDicomIndex(const std::string& path);

// Returns the files of a folder, sorted by name, without DICOMDIR, folders, pipes and the like.
std::vector<std::string> DicomCandidatesIn(const std::string& folder);
// True if one of them is a DICOM file. Opens files up to the first one.
bool HasDicomFile(const std::string& folder);
// True if one of the folders below has a DICOM file. Opens 10 000 files at most.
bool HasDicomFileBelow(const std::string& folder);
// Returns the DICOM files, of any series, among which FindDicomSeries looks. Errors: as there.
absl::StatusOr<std::vector<std::string>> DicomFilesOf(const std::string& path);

// The series that FindDicomSeries can choose from, by number. NOT_FOUND: no DICOM files with an
// image. Files that are cut before their series is known are left out. Other errors: as there.
absl::StatusOr<std::vector<SeriesEntry>> ListDicomSeries(const std::string& path);
// A file of the series of that number or UID. INVALID_ARGUMENT: no such series, or several of that
// number (lists them). Other errors: as ListDicomSeries.
absl::StatusOr<std::string> FindDicomSeriesFile(const std::string& path, const std::string& choice);
// "3 \"T1 axial\", 30 images of 512 x 512", and " in a/b" of a folder below.
std::string DescribeDicomSeries(const SeriesEntry& entry);

// The files of one series.
struct DicomSeriesFiles {
  struct File {
    std::string path;
    DicomScan scan;  // an image, or one that is cut
  };
  std::vector<File> images{};           // by name; at least one
  std::vector<std::string> left_out{};  // DICOM files among the others that hold no image
  bool is_of_file = false;              // the path is a file of the series
};
// Finds the only series in a folder, that of number or UID `choice` if it is not "", or the series
// that a file belongs to. `decoder` finds the series of files that the scan can't read.
//
//   path                              looked at
//   a file                            its folder
//   a folder with an image            that folder
//   another folder, an index          the folders below, too: 8 deep, without those whose names
//                                     begin with a dot
//
// NOT_FOUND: no DICOM files with an image. INVALID_ARGUMENT: several series, or none of that choice
// (lists them); a file that is cut before its series is known; a file without an image.
// RESOURCE_EXHAUSTED: more than 100 000 files below. Errors of reading: a file can't be read.
absl::StatusOr<DicomSeriesFiles> FindDicomSeries(const std::string& path, const std::string& choice,
                                                 DicomDecoder* decoder);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_DICOM_DICOM_FOLDER_H_
