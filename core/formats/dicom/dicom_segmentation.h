// DICOM segmentations (SEG) as sources of labels.

#ifndef ISOSCOPE_CORE_FORMATS_DICOM_DICOM_SEGMENTATION_H_
#define ISOSCOPE_CORE_FORMATS_DICOM_DICOM_SEGMENTATION_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "core/formats/dicom/dicom_scan.h"
#include "core/source/grid/grid_rules.h"
#include "core/source/volume_series.h"

namespace isoscope::source {

// Opens a file for whose class IsSegmentationStorage holds. Samples are numbers of segments, 0 (or
// the file's padding value) where there is none; uint8 if they fit, else uint16:
//
//   BINARY      one field; with segments that overlap "layer 1", "layer 2", ...: a segment is in
//               the first layer in which it overlaps none of a lower number
//   LABELMAP    one field
//   FRACTIONAL  a field for each segment, whose samples are the shares as they are stored
//
// `field` is the name of an only field. Planes that the file leaves out are empty. Memory: a plane
// of each segment there while the file is opened, at most 16 MiB, then two planes.
// INVALID_ARGUMENT: a header that can't be decoded; frames without a place in the patient (tiles of
// slides) or a segment; not on a straight line, or not at multiples of one distance; one plane;
// pixels of one bit that are compressed; a segment twice at one place; more segments than
// SegmentOverlaps takes. DATA_LOSS: pixels can't be read. RESOURCE_EXHAUSTED: the system gives no
// process.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenDicomSegmentation(const std::string& path,
                                                                    const DicomScan& scan,
                                                                    const std::string& field,
                                                                    const GridRules& rules = {});

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_DICOM_DICOM_SEGMENTATION_H_
