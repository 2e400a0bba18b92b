// A DICOM series as a source.

#ifndef ISOSCOPE_CORE_FORMATS_DICOM_DICOM_SOURCE_H_
#define ISOSCOPE_CORE_FORMATS_DICOM_DICOM_SOURCE_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "core/source/grid/grid_rules.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"

namespace isoscope::source {

// Opens the series in a folder, or the series of a file in its folder, by ITK and GDCM. Each file
// or frame is a slice. Slices are sorted by position along their normal, not by name. World
// coordinates are DICOM's, LPS. Files of the folder that hold no image (an index, a report) are
// left out, with one warning in the log. The libraries run in a process of their own, a child of
// this one that lives as long as the source (dicom_decoder.h). So a file on which they abort, crash
// or hang is an error like any other. Memory: two slices here, a few in the child. NOT_FOUND: no
// DICOM files with an image. INVALID_ARGUMENT: several series in a folder (lists them); a slice
// that is cut; slices of different size, type or orientation; a distance between slices that is not
// the same everywhere (beyond 1 %: one is missing, or there twice), unless the rules resample;
// slices beside the straight line from the first to the last; frames without a position; colour; a
// header that can't be decoded. DATA_LOSS: pixels that can't be decoded. RESOURCE_EXHAUSTED: the
// system gives no process. No message quotes a field of the examination but the descriptions of
// series. Not thread-safe (the libraries keep globals).
//
// The line of the slices need not be their normal. With a tilted gantry it is the third axis of the
// grid, so each sample lies where the scanner had it.
//
// A segmentation is a volume of its own (dicom_segmentation.h); a folder with several in a series
// is INVALID_ARGUMENT.
//
// Several images at each place are steps (dicom_steps.h). `field` is the name of the only field.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenDicomSteps(const std::string& path,
                                                             const std::string& field,
                                                             const GridRules& rules = {});
}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_DICOM_DICOM_SOURCE_H_
