// The DICOM series in a folder: which there are, and which files make one.

#ifndef ISOSCOPE_CORE_SOURCE_DICOM_FOLDER_H_
#define ISOSCOPE_CORE_SOURCE_DICOM_FOLDER_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/dicom_decoder.h"
#include "core/source/dicom_scan.h"

namespace isoscope::source {

// True if the file carries the DICOM mark.
bool IsDicomFile(const std::string& path);

// Returns the files of a folder, sorted by name, without DICOMDIR, folders, pipes and the like:
// all, or those that carry the mark.
std::vector<std::string> DicomCandidatesIn(const std::string& folder);
std::vector<std::string> DicomFilesIn(const std::string& folder);
// True if DicomFilesIn would find some. Opens files up to the first one.
bool HasDicomFile(const std::string& folder);
// Returns the folder of the series that `path` names: `path` itself, or the folder of a file.
std::string DicomFolder(const std::string& path);

// A series of a folder, for people who choose one.
struct DicomSeriesEntry {
  std::string uid;
  std::int64_t number = 0;
  std::string description;  // may be empty
  std::int64_t width = 0;   // of the first of its files
  std::int64_t height = 0;
  std::int64_t images = 0;  // files, or frames of all
  std::string first_file;
};
// The series in a folder, by number. NOT_FOUND: no DICOM files with an image. Files that are cut
// before their series is known are left out. Errors of reading: a file of the folder can't be read.
absl::StatusOr<std::vector<DicomSeriesEntry>> ListDicomSeries(const std::string& folder);
// A file of the series of that number or UID in a folder, or in the folder of a file.
// INVALID_ARGUMENT: no such series, or several of that number (lists them).
absl::StatusOr<std::string> FindDicomSeriesFile(const std::string& path, const std::string& choice);
// "3 \"T1 axial\", 30 images of 512 x 512".
std::string DescribeDicomSeries(const DicomSeriesEntry& entry);

// The files of one series.
struct DicomSeriesFiles {
  struct File {
    std::string path;
    DicomScan scan;  // an image, or one that is cut
  };
  std::vector<File> images;           // by name; at least one
  std::vector<std::string> left_out;  // files of the folder with the mark that hold no image
};
// Finds the only series in a folder, or the series that a file belongs to, in the file's folder.
// `decoder` finds the series of files that the scan can't read. NOT_FOUND: no DICOM files with an
// image. INVALID_ARGUMENT: several series in a folder (lists them); a file that is cut before its
// series is known; a file without an image. Errors of reading, as above.
absl::StatusOr<DicomSeriesFiles> FindDicomSeries(const std::string& path, DicomDecoder* decoder);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_DICOM_FOLDER_H_
