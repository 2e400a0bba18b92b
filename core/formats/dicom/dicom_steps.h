// The steps of a DICOM series with several images at each place.

#ifndef ISOSCOPE_CORE_FORMATS_DICOM_DICOM_STEPS_H_
#define ISOSCOPE_CORE_FORMATS_DICOM_DICOM_STEPS_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/formats/dicom/dicom_scan.h"
#include "core/formats/dicom/dicom_values.h"
#include "core/math/matrix.h"
#include "core/math/vec.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

struct DicomSlice {
  std::string path;
  std::int64_t frame = -1;  // of a file of many frames; -1: the only one
  std::int64_t width = 0;
  std::int64_t height = 0;
  volume::ScalarType type = volume::ScalarType::kUint8;
  math::Vec3d origin;
  math::Vec3d spacing;
  bool has_spacing = true;  // as DicomPlane
  math::Mat3d direction;
  double position = 0;  // along the normal
  DicomValues values;
  bool is_on_patient = true;  // world axes are those of the patient
  bool is_decoded = false;    // its pixels are compressed, or not where DicomScan finds them
  DicomMoment moment;
  // As DicomScan.
  std::string frame_of_reference{};
  std::string value_unit{};
};

struct DicomSteps {
  std::vector<std::vector<DicomSlice>> steps;  // each by position; at least one
  std::vector<double> times{};                 // none if there is one step
  std::string time_unit{};
};

// Divides slices into steps, by the first of these that tells the slices of every place apart:
//
//   temporal position                       numbers
//   echo time, trigger time                 ms
//   rank in the dimensions of the file      numbers
//   acquisition number                      numbers
//   acquisition time, content time          s from the first one on
//   instance number                         numbers
//
// Numbers become ms if there is a temporal resolution. Places with different numbers of images, or
// one image each, make one step. INVALID_ARGUMENT: nothing tells them apart, or some steps lack a
// few images (says how many).
absl::StatusOr<DicomSteps> SplitDicomSteps(std::vector<DicomSlice> slices, const std::string& name);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_DICOM_DICOM_STEPS_H_
