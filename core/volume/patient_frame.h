// The meaning of the world axes on a patient.

#ifndef ISOSCOPE_CORE_VOLUME_PATIENT_FRAME_H_
#define ISOSCOPE_CORE_VOLUME_PATIENT_FRAME_H_

#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/math/vec.h"

namespace isoscope::volume {

// The sides of a patient. On disk and on the wire as their first letters.
enum class PatientSide : char {
  kLeft = 'L',
  kRight = 'R',
  kPosterior = 'P',
  kAnterior = 'A',
  kSuperior = 'S',
  kInferior = 'I',
};

// Three letters: the sides that world +x, +y and +z point to. "LPS" is the world of DICOM and ITK.
class PatientFrame {
 public:
  // LPS.
  PatientFrame() = default;

  // Returns the frame of that name. INVALID_ARGUMENT unless it has three letters, one of L and R,
  // one of P and A, one of S and I, in any order.
  static absl::StatusOr<PatientFrame> FromName(absl::string_view name);

  [[nodiscard]] const std::string& name() const { return name_; }
  // The unit vector, world space, that points to a side of the patient.
  [[nodiscard]] math::Vec3d DirectionTo(PatientSide side) const;

  friend bool operator==(const PatientFrame&, const PatientFrame&) = default;

 private:
  std::string name_ = "LPS";
};

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_PATIENT_FRAME_H_
