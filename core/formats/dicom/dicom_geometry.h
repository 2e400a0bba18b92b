// Where the frames of a DICOM file lie on the patient.

#ifndef ISOSCOPE_CORE_FORMATS_DICOM_DICOM_GEOMETRY_H_
#define ISOSCOPE_CORE_FORMATS_DICOM_DICOM_GEOMETRY_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/formats/dicom/dicom_decoder.h"
#include "core/math/matrix.h"
#include "core/math/vec.h"

namespace isoscope::source {

// The plane of a frame.
struct DicomPlane {
  math::Vec3d origin;       // the first pixel, LPS, mm
  math::Vec3d spacing;      // of pixels along x and y, above 0; 1 along z
  math::Mat3d direction;    // of rows, of columns, and their cross product
  double position = 0;      // of the first pixel along the third direction
  bool has_spacing = true;  // false: the spacing is 1 in place of none that makes sense
};

// Reads the plane that a frame names itself. `name` stands before the message: a path, or a path
// and the number of a frame. `fallback`: the distance of pixels if the frame has none.
// `has_spacing`: it is 1 if it is missing or can't be, because the user gives another.
// INVALID_ARGUMENT, with the element and what to do: position (0020,0032), orientation (0020,0037)
// or distance of pixels (0028,0030) is missing, is not the numbers that it should be, or can't be:
// directions that are not at right angles and of length 1 (within 1 %), distances of 0 or less.
absl::StatusOr<DicomPlane> PlaneOfDicomFrame(const DicomFrame& frame, const std::string& name,
                                             const DicomNumbers<2>& fallback = {},
                                             bool has_spacing = false);

// Returns the planes of all frames of a file, in its order. Frames without functional groups lie
// along the normal of one plane, as their class says (dicom_geometry.cc). `has_spacing`: as
// above, also of the distance between slices.
// INVALID_ARGUMENT: as above; frames that are no slices of one place each (moments in time,
// projections); a distance between slices that is missing, 0, or negative where its sign has no
// meaning; offsets of a dose grid that are not as many as frames, or not in order; numbers of
// frames in their stack (0020,9057) that are not in the order of their places.
absl::StatusOr<std::vector<DicomPlane>> PlanesOfDicomFrames(const DicomFrames& file,
                                                            absl::string_view storage_class,
                                                            const std::string& path,
                                                            bool has_spacing = false);

// Orders the frames of a file by their indices of all dimensions but those of space, from 0 on:
// frames at one place have different ranks. Empty if frames have no such indices.
std::vector<double> RanksOfDicomFrames(const DicomFrames& file);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_DICOM_DICOM_GEOMETRY_H_
