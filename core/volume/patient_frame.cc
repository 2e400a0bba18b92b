#include "core/volume/patient_frame.h"

#include <array>
#include <cstddef>

#include "absl/strings/str_cat.h"

#include "core/base/check.h"

namespace isoscope::volume {
namespace {

constexpr std::array<absl::string_view, 3> kOpposites{"LR", "PA", "SI"};

// Returns the pair of opposite sides that a letter belongs to; -1 if none.
int PairOf(char letter) {
  for (std::size_t pair = 0; pair < kOpposites.size(); ++pair) {
    if (kOpposites[pair].find(letter) != absl::string_view::npos) {
      return static_cast<int>(pair);
    }
  }
  return -1;
}

}  // namespace

absl::StatusOr<PatientFrame> PatientFrame::FromName(absl::string_view name) {
  bool is_valid = name.size() == 3;
  std::array<bool, 3> has_pair{};
  for (std::size_t i = 0; is_valid && i < name.size(); ++i) {
    const int pair = PairOf(name[i]);
    is_valid = pair >= 0 && !has_pair[static_cast<std::size_t>(pair)];
    if (is_valid) {
      has_pair[static_cast<std::size_t>(pair)] = true;
    }
  }
  if (!is_valid) {
    return absl::InvalidArgumentError(absl::StrCat(
        "patient frame \"", name,
        "\": expected three letters, one of L and R, one of P and A, one of S and I: \"LPS\""));
  }
  PatientFrame frame;
  frame.name_ = std::string(name);
  return frame;
}

math::Vec3d PatientFrame::DirectionTo(PatientSide side) const {
  const auto letter = static_cast<char>(side);
  for (int axis = 0; axis < 3; ++axis) {
    const char positive = name_[static_cast<std::size_t>(axis)];
    if (PairOf(positive) == PairOf(letter)) {
      math::Vec3d direction;
      direction[axis] = positive == letter ? 1 : -1;
      return direction;
    }
  }
  base::CheckFailed(__FILE__, __LINE__, "patient side out of range");
}

}  // namespace isoscope::volume
