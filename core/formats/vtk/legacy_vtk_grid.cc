// The grid is words behind keywords:
//
//   DIMENSIONS 4 3 2             points on each axis
//   ORIGIN 10 20 30              structured points have these two,
//   SPACING 0.5 2 4              the second one as ASPECT_RATIO in files of version 1
//   X_COORDINATES 4 float        a rectilinear grid has these, each with its numbers:
//   0 1 2.5 4                    text, or big-endian

#include "core/formats/vtk/legacy_vtk_grid.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstring>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/source/bytes/byte_order.h"
#include "core/source/grid/grid_faults.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxLegacyAxis = std::int64_t{1} << 24;

}  // namespace

absl::StatusOr<bool> LegacyGrid::Take(const std::string& keyword, bool is_binary,
                                      LegacyWords* words) {
  if (keyword == "DIMENSIONS") {
    for (int axis = 0; axis < 3; ++axis) {
      ISOSCOPE_ASSIGN_OR_RETURN(dims_[axis], words->NextCount("DIMENSIONS has", 1, kMaxLegacyAxis));
    }
    return true;
  }
  if (is_rectilinear_ && keyword.size() == 13 && keyword.substr(1) == "_COORDINATES" &&
      keyword[0] >= 'X' && keyword[0] <= 'Z') {
    ISOSCOPE_RETURN_IF_ERROR(
        TakeCoordinates(static_cast<std::size_t>(keyword[0] - 'X'), is_binary, words));
    return true;
  }
  if (!is_rectilinear_ && keyword == "ORIGIN") {
    ISOSCOPE_ASSIGN_OR_RETURN(origin_, words->NextVector("ORIGIN"));
    return true;
  }
  if (!is_rectilinear_ && (keyword == "SPACING" || keyword == "ASPECT_RATIO")) {
    ISOSCOPE_ASSIGN_OR_RETURN(spacing_, words->NextVector(keyword));
    return true;
  }
  return false;
}

absl::Status LegacyGrid::TakeCoordinates(std::size_t axis, bool is_binary, LegacyWords* words) {
  const std::string name = absl::StrFormat("%c_COORDINATES", "XYZ"[axis]);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t count, words->NextCount(name, 1, kMaxLegacyAxis));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string type_name, words->NextText());
  ISOSCOPE_RETURN_IF_ERROR(words->NextLine().status());
  const std::string type = absl::AsciiStrToLower(type_name);
  if (type != "float" && type != "double") {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s of type \"%s\"; expected float or double", name, type.substr(0, 64)));
  }
  const std::size_t size = type == "float" ? sizeof(float) : sizeof(double);
  axes_.is_single = axes_.is_single || size == sizeof(float);
  const std::int64_t begin = words->position();
  std::vector<double>& values = axes_.points[axis];
  values.clear();
  if (is_binary) {
    ISOSCOPE_RETURN_IF_ERROR(
        words->PassNumbers(1, count, static_cast<std::int64_t>(8 * size), true));
    std::string bytes(static_cast<std::size_t>(count) * size, '\0');
    ISOSCOPE_RETURN_IF_ERROR(words->file().ReadAt(begin, bytes.size(), bytes.data()));
    SwapBytes(size, static_cast<std::size_t>(count), bytes.data());
    for (std::size_t i = 0; i < bytes.size(); i += size) {
      values.push_back(size == sizeof(float)
                           ? static_cast<double>(base::LoadLittleEndian<float>(&bytes[i]))
                           : base::LoadLittleEndian<double>(&bytes[i]));
    }
    return absl::OkStatus();
  }
  for (std::int64_t i = 0; i < count; ++i) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string word, words->NextText());
    if (!absl::SimpleAtod(word, &values.emplace_back())) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s has \"%s\"; expected numbers", name, word.substr(0, 64)));
    }
  }
  return absl::OkStatus();
}

absl::StatusOr<CfUnevenGrid> LegacyGrid::Locate(bool is_of_cells, const GridRules& rules) const {
  if (!is_rectilinear_) {
    CfUnevenGrid even;
    even.geometry.sample_dims = dims_;
    even.geometry.spacing = spacing_;
    even.geometry.origin = origin_;
    for (int axis = 0; axis < 3; ++axis) {
      if (is_of_cells) {
        even.geometry.sample_dims[axis] -= 1;
        even.geometry.origin[axis] += std::isfinite(spacing_[axis]) ? spacing_[axis] / 2 : 0;
      }
      if (spacing_[axis] < 0) {  // points follow each other against the axis
        even.geometry.spacing[axis] = -spacing_[axis];
        even.geometry.direction.columns[static_cast<std::size_t>(axis)][axis] = -1;
      }
    }
    ISOSCOPE_RETURN_IF_ERROR(TakeGridByRules("", rules, &even.geometry));
    return even;
  }
  for (std::size_t axis = 3; axis-- > 0;) {
    const std::int64_t points = dims_[static_cast<int>(axis)];
    if (static_cast<std::int64_t>(axes_.points[axis].size()) != points) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%d %c_COORDINATES; DIMENSIONS %d %d %d have %d", axes_.points[axis].size(), "XYZ"[axis],
          dims_.x, dims_.y, dims_.z, points));
    }
  }
  return RectilinearGridOf(axes_, is_of_cells, rules);
}

}  // namespace isoscope::source
