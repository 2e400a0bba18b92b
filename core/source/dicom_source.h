// A DICOM series as a source.

#ifndef ISOSCOPE_CORE_SOURCE_DICOM_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_DICOM_SOURCE_H_

#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/volume_source.h"

namespace isoscope::source {

// True if the file carries the DICOM mark.
bool IsDicomFile(const std::string& path);

// Returns the files of a folder that carry the mark, sorted by name, without DICOMDIR.
std::vector<std::string> DicomFilesIn(const std::string& folder);
// Returns the folder of the series that `path` names: `path` itself, or the folder of a file.
std::string DicomFolder(const std::string& path);

// Opens the series in a folder, or the series that a file belongs to (in the file's folder), by ITK
// and GDCM: one file a slice, sorted by position along the normal of the slices, not by name. World
// coordinates are DICOM's, LPS. Files of the folder that hold no image (an index, a report) are
// left out, with one warning in the log. The libraries run in a process of their own, a child of
// this one that lives as long as the source (dicom_decoder.h). So a file on which they abort, crash
// or hang is an error like any other. Memory: two slices here, a few in the child. NOT_FOUND: no
// DICOM files with an image. INVALID_ARGUMENT: several series in a folder (lists them); a slice
// that is cut; slices of different size, type or orientation; a distance between slices that is not
// the same everywhere (beyond 1 %: one is missing, or there twice); slices not stacked along their
// normal (a tilted gantry); files of many frames; colour; a header that can't be decoded.
// DATA_LOSS: pixels that can't be decoded. RESOURCE_EXHAUSTED: the system gives no process. No
// message quotes a field of the examination. Not thread-safe (the libraries keep globals).
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenDicomSeries(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_DICOM_SOURCE_H_
