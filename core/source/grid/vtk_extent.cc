// An extent counts points, inclusive, and may begin anywhere. The origin is that of index 0:
//
//   WholeExtent="2 5 ..." Origin="10 ..." Spacing="0.5 ..."
//   points   2     3     4     5        4 of them, at 11, 11.5, 12, 12.5
//   cells       |     |     |           3, their centres at 11.25, 11.75, 12.25
//
// Direction has a matrix row by row; its columns are the directions of x, y and z. Point i lies at
// Origin + Direction * (Spacing * i), also where Spacing is negative. Without an attribute the
// origin is 0 and the spacing 1, as VTK reads it. Source: VTK's file format description, "XML File
// Formats", https://docs.vtk.org.

#include "core/source/grid/vtk_extent.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <type_traits>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"

#include "core/base/status_macros.h"

namespace isoscope::source {
namespace {

// `count` numbers in `text`.
template <typename T>
absl::StatusOr<std::vector<T>> ParseNumbers(const std::string& text, std::size_t count,
                                            const char* what, const std::string& path) {
  std::vector<T> numbers;
  for (const absl::string_view part :
       absl::StrSplit(text, absl::ByAnyChar(" \t\r\n"), absl::SkipEmpty())) {
    T number{};
    bool is_number = false;
    if constexpr (std::is_same_v<T, double>) {
      is_number = absl::SimpleAtod(part, &number);
    } else {
      is_number = absl::SimpleAtoi(part, &number);
    }
    if (!is_number) {
      break;
    }
    numbers.push_back(number);
  }
  if (numbers.size() != count) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %s=\"%s\"; expected %d numbers", path, what, text, count));
  }
  return numbers;
}
}  // namespace

absl::StatusOr<VtkExtent> ParseVtkExtent(const std::string& text, const char* attribute,
                                         const std::string& path) {
  constexpr std::int64_t kMaxIndex = std::numeric_limits<std::int32_t>::max();  // VTK's own
  VtkExtent extent{};
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::int64_t> numbers,
                            ParseNumbers<std::int64_t>(text, extent.size(), attribute, path));
  for (const std::int64_t index : numbers) {
    if (index < -kMaxIndex || index > kMaxIndex) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: %s=\"%s\"; expected 32-bit numbers", path, attribute, text));
    }
  }
  std::copy(numbers.begin(), numbers.end(), extent.begin());
  return extent;
}

absl::StatusOr<volume::GridGeometry> VtkGridOf(const VtkAttributes& image, const VtkExtent& extent,
                                               bool is_of_cells, const std::string& path) {
  const auto get = [&](const char* name, const char* fallback) {
    const auto found = image.find(name);
    return found == image.end() ? std::string(fallback) : found->second;
  };
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> origin,
                            ParseNumbers<double>(get("Origin", "0 0 0"), 3, "Origin", path));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> spacing,
                            ParseNumbers<double>(get("Spacing", "1 1 1"), 3, "Spacing", path));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::vector<double> direction,
      ParseNumbers<double>(get("Direction", "1 0 0 0 1 0 0 0 1"), 9, "Direction", path));
  volume::GridGeometry geometry;
  geometry.origin = {origin[0], origin[1], origin[2]};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto index = static_cast<int>(axis);
    const std::int64_t point_count = extent[2 * axis + 1] - extent[2 * axis] + 1;
    geometry.sample_dims[index] = point_count - (is_of_cells ? 1 : 0);
    geometry.spacing[index] = spacing[axis];
    geometry.direction.columns[axis] = {direction[axis], direction[3 + axis], direction[6 + axis]};
    // VTK's origin is that of the point with index 0.
    const double first = static_cast<double>(extent[2 * axis]) + (is_of_cells ? 0.5 : 0.0);
    const math::Vec3d shift = geometry.direction.columns[axis] * (spacing[axis] * first);
    if (math::IsFinite(shift)) {
      geometry.origin = geometry.origin + shift;
    }
    if (spacing[axis] < 0) {  // samples follow each other against the direction
      geometry.spacing[index] = -spacing[axis];
      geometry.direction.columns[axis] = geometry.direction.columns[axis] * -1.0;
    }
  }
  return geometry;
}

}  // namespace isoscope::source
