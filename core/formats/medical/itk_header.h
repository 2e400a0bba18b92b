// The geometry and sample type of a volume file, NRRD or MetaImage. ITK reads the header, but for
// the grid of MetaImage, which our own reader finds (meta_image_grid.h).

#ifndef ISOSCOPE_CORE_FORMATS_MEDICAL_ITK_HEADER_H_
#define ISOSCOPE_CORE_FORMATS_MEDICAL_ITK_HEADER_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/formats/medical/sample_format.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/patient_frame.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

struct ImageHeader {
  // In ITK's world, LPS: x to the patient's left, y to the back, z up. NRRD whose "space"
  // is RAS is turned by ITK: x and y change their signs.
  volume::GridGeometry geometry;
  volume::ScalarType type = volume::ScalarType::kUint8;
  // LPS, if the file defines how its world lies in the patient: NRRD with the space LPS or RAS.
  // MetaImage does not define it.
  std::optional<volume::PatientFrame> patient_frame;
};

// The whole grid of a file that holds more than one volume.
struct ImageLayout {
  volume::GridGeometry geometry;           // of the first three axes
  std::vector<std::int64_t> dims;          // of all axes, at least three, fastest first
  std::int64_t components = 1;             // of a tuple
  std::optional<volume::ScalarType> type;  // not set: none that a volume can have
  std::optional<volume::PatientFrame> patient_frame;
};

// As ReadImageHeader, with any number of axes and components, and any type.
absl::StatusOr<ImageLayout> ReadImageLayout(FileFormat format, const std::string& path);

// Reads the header only, no sample. Everything ITK throws becomes a status.
// INVALID_ARGUMENT: not of that format; not three-dimensional (more axes are accepted if each has
// one sample); more than one component a sample; 64-bit integers; a geometry that can't be used.
// Not thread-safe (ITK's file libraries keep globals).
absl::StatusOr<ImageHeader> ReadImageHeader(FileFormat format, const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_MEDICAL_ITK_HEADER_H_
