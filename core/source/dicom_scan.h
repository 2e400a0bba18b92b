// Tells, without GDCM, whether a DICOM file is an image, and whether it is whole.

#ifndef ISOSCOPE_CORE_SOURCE_DICOM_SCAN_H_
#define ISOSCOPE_CORE_SOURCE_DICOM_SCAN_H_

#include <string>

#include "absl/status/statusor.h"

namespace isoscope::source {

enum class DicomContent {
  kImage,    // whole up to the end of its pixels
  kNoImage,  // an index (DICOMDIR), a report, a plan: nothing that has pixels
  kCut       // an image that ends before its pixels do, or bytes that are no DICOM file
};

struct DicomScan {
  DicomContent content = DicomContent::kCut;
  // UIDs, "" if the file ends before or does not say: the series, and how the pixels are encoded.
  std::string series;
  std::string transfer_syntax;
  // Whether an image has as many pixels as its rows and columns say; else they were not counted.
  bool is_counted = false;
};

// Looks through the file, element by element, without its pixels. It keeps nothing of the patient's
// fields. Errors: those of reading.
absl::StatusOr<DicomScan> ScanDicomFile(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_DICOM_SCAN_H_
