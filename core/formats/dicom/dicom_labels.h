// The names and colours of the segments of a DICOM segmentation.

#ifndef ISOSCOPE_CORE_FORMATS_DICOM_DICOM_LABELS_H_
#define ISOSCOPE_CORE_FORMATS_DICOM_DICOM_LABELS_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/volume/label.h"

namespace isoscope::source {

// The segments of the file, or of the first image of the folder, with their numbers as values,
// names and colours. Empty if that is no segmentation, if its samples are shares, or if it can't be
// read. INVALID_ARGUMENT: labels that volume::ValidateLabels refuses.
absl::StatusOr<std::vector<volume::Label>> ReadDicomLabels(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_DICOM_DICOM_LABELS_H_
