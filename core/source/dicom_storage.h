// Storage classes of DICOM files.

#ifndef ISOSCOPE_CORE_SOURCE_DICOM_STORAGE_H_
#define ISOSCOPE_CORE_SOURCE_DICOM_STORAGE_H_

#include "absl/strings/string_view.h"

namespace isoscope::source {

enum class DicomStorage {
  kUnknown,  // a maker's own, or none
  kImage,    // its files have pixels
  kOther,    // they have none: reports, plans, curves, directories
};

// Returns the kind of a media storage class (0002,0002), a UID without filling.
DicomStorage DicomStorageOf(absl::string_view uid);

// Frames of segments, or of their numbers.
bool IsSegmentationStorage(absl::string_view uid);
// Tiles of planes, without a place in a patient.
bool IsWholeSlideStorage(absl::string_view uid);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_DICOM_STORAGE_H_
