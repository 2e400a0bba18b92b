// A DICOM series as a source.

#ifndef ISOSCOPE_CORE_SOURCE_DICOM_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_DICOM_SOURCE_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/grid_rules.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"

namespace isoscope::source {

// True if the file carries the DICOM mark.
bool IsDicomFile(const std::string& path);

// Returns the files of a folder that carry the mark, sorted by name, without DICOMDIR.
std::vector<std::string> DicomFilesIn(const std::string& folder);
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
// before their series is known are left out.
absl::StatusOr<std::vector<DicomSeriesEntry>> ListDicomSeries(const std::string& folder);
// A file of the series of that number or UID in a folder, or in the folder of a file.
// INVALID_ARGUMENT: no such series, or several of that number (lists them).
absl::StatusOr<std::string> FindDicomSeriesFile(const std::string& path, const std::string& choice);
// "3 \"T1 axial\", 30 images of 512 x 512".
std::string DescribeDicomSeries(const DicomSeriesEntry& entry);

// Opens the series in a folder, or the series that a file belongs to (in the file's folder), by ITK
// and GDCM: one file or frame a slice, sorted by position along the normal of the slices, not by
// name. World coordinates are DICOM's, LPS. Files of the folder that hold no image (an index, a
// report) are left out, with one warning in the log. The libraries run in a process of their own, a
// child of this one that lives as long as the source (dicom_decoder.h). So a file on which they
// abort, crash or hang is an error like any other. Memory: two slices here, a few in the child.
// NOT_FOUND: no DICOM files with an image. INVALID_ARGUMENT: several series in a folder (lists
// them); a slice that is cut; slices of different size, type or orientation; a distance between
// slices that is not the same everywhere (beyond 1 %: one is missing, or there twice), unless the
// rules resample; slices beside the straight line from the first to the last; frames without a
// position; colour; a header that can't be decoded. DATA_LOSS: pixels that can't be decoded.
// RESOURCE_EXHAUSTED: the system gives no process. No message quotes a field of the examination but
// the descriptions of series. Not thread-safe (the libraries keep globals).
//
// The line of the slices need not be their normal: with a tilted gantry the third axis of the grid
// is that line, so that each sample lies where the scanner had it.
//
// Several images at each place are steps (dicom_steps.h). `field` is the name of the only field.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenDicomSteps(const std::string& path,
                                                             const std::string& field,
                                                             const GridRules& rules = {});
// The same of a series of one step. INVALID_ARGUMENT also: there are several.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenDicomSeries(const std::string& path,
                                                              const GridRules& rules = {});

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_DICOM_SOURCE_H_
