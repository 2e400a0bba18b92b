// Finds out, without GDCM, whether a DICOM file is an image, and whether it is complete.

#ifndef ISOSCOPE_CORE_SOURCE_DICOM_SCAN_H_
#define ISOSCOPE_CORE_SOURCE_DICOM_SCAN_H_

#include <string>

#include "absl/status/statusor.h"

namespace isoscope::source {

enum class DicomContent {
  kImage,    // whole up to the end of its pixels
  kNoImage,  // an index (DICOMDIR), a report, a plan: it has no pixels
  kCut       // an image that ends before its pixels do, or bytes that are no DICOM file
};

struct DicomScan {
  DicomContent content = DicomContent::kCut;
  // UIDs of the series and of the pixels' encoding; "" if the file ends before, or has none.
  std::string series;
  std::string transfer_syntax;
  // Whether an image has as many pixels as its rows and columns say; else they were not counted.
  bool is_counted = false;
};

// Scans the file element by element, without its pixels. Keeps no field of the patient. Errors:
// those of reading.
absl::StatusOr<DicomScan> ScanDicomFile(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_DICOM_SCAN_H_
