// Storage classes of DICOM files.

#ifndef ISOSCOPE_CORE_FORMATS_DICOM_DICOM_STORAGE_H_
#define ISOSCOPE_CORE_FORMATS_DICOM_DICOM_STORAGE_H_

#include "absl/strings/string_view.h"

namespace isoscope::source {

enum class DicomStorage {
  kUnknown,  // a maker's own, or none
  kImage,    // its files have pixels
  kOther,    // they have none: reports, plans, curves, directories
};

// Returns the kind of a media storage class (0002,0002), a UID without filling.
DicomStorage DicomStorageOf(absl::string_view uid);

// Nuclear medicine: one position for all frames, and a distance with a sign.
bool IsNuclearStorage(absl::string_view uid);
// Doses of radiotherapy, on a grid.
bool IsDoseStorage(absl::string_view uid);
// Volumes of ultrasound: places count from the probe, not on the patient.
bool IsUltrasoundVolumeStorage(absl::string_view uid);
// Images that were scanned or captured, of one frame or many.
bool IsSecondaryCaptureStorage(absl::string_view uid);
// Directories of a medium: the files named DICOMDIR.
bool IsDirectoryStorage(absl::string_view uid);
// Frames of segments, or of their numbers.
bool IsSegmentationStorage(absl::string_view uid);
// Tiles of planes, without a place in a patient.
bool IsWholeSlideStorage(absl::string_view uid);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_DICOM_DICOM_STORAGE_H_
