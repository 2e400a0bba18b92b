#include "core/formats/vtk/vti_choice.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/string_view.h"

namespace isoscope::source {
namespace {

struct KnownType {
  const char* name;
  volume::ScalarType type;
};
constexpr std::array<KnownType, 8> kTypes{{{"UInt8", volume::ScalarType::kUint8},
                                           {"Int8", volume::ScalarType::kInt8},
                                           {"UInt16", volume::ScalarType::kUint16},
                                           {"Int16", volume::ScalarType::kInt16},
                                           {"UInt32", volume::ScalarType::kUint32},
                                           {"Int32", volume::ScalarType::kInt32},
                                           {"Float32", volume::ScalarType::kFloat32},
                                           {"Float64", volume::ScalarType::kFloat64}}};

const KnownType* FindType(const std::string& name) {
  const auto* row = std::find_if(kTypes.begin(), kTypes.end(),
                                 [&](const KnownType& known) { return name == known.name; });
  return row == kTypes.end() ? nullptr : row;
}

// "point array "velocity" of 3 components, cell array "p"".
std::string Listed(const VtiHeader& header) {
  constexpr std::size_t kMaxListed = 50;
  std::vector<std::string> lines;
  for (const VtiArray& array : header.arrays) {
    if (lines.size() == kMaxListed) {
      lines.emplace_back("and more");
      break;
    }
    lines.push_back(absl::StrCat(
        array.is_of_cells ? "cell" : "point", " array \"", array.name, "\"",
        array.components > 1 ? absl::StrCat(" of ", array.components, " components") : ""));
  }
  return absl::StrJoin(lines, ", ");
}

const VtiArray* FindNamed(const VtiHeader& header, absl::string_view name) {
  const VtiArray* found = nullptr;
  for (const VtiArray& array : header.arrays) {
    if (array.name == name && (found == nullptr || (found->is_of_cells && !array.is_of_cells))) {
      found = &array;
    }
  }
  return found;
}

const VtiArray* FindDefault(const VtiHeader& header) {
  const VtiArray* found = nullptr;
  const auto rank = [&](const VtiArray& array) {
    return array.is_of_cells ? (array.name == header.cell_scalars ? 1 : 0)
                             : (array.name == header.point_scalars ? 3 : 2);
  };
  for (const VtiArray& array : header.arrays) {
    if (IsDefaultVtiArray(array) && (found == nullptr || rank(array) > rank(*found))) {
      found = &array;
    }
  }
  return found;
}

absl::Status WithoutChoice(const VtiHeader& header, const VtiArray& array,
                           const std::string& path) {
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s: array \"%s\" has %d components: choose one of 0 to %d, as in %s:%s:0; the file holds %s",
      path, array.name, array.components, array.components - 1, path, array.name, Listed(header)));
}
}  // namespace

bool IsDefaultVtiArray(const VtiArray& array) {
  return array.components == 1 && FindType(array.type) != nullptr && array.name != "vtkGhostType";
}
absl::StatusOr<VtiChoice> ChooseVtiArray(const VtiHeader& header, const std::string& part,
                                         const std::string& path) {
  if (!(header.is_image || header.is_rectilinear) || header.piece_count < 1 ||
      header.arrays.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": no ", header.is_rectilinear ? "RectilinearGrid" : "ImageData",
                     " with an array in its PointData or CellData"));
  }
  if (part.empty()) {
    const VtiArray* found = FindDefault(header);
    if (found != nullptr) {
      return VtiChoice{*found, 0};
    }
    const auto single = std::find_if(header.arrays.begin(), header.arrays.end(),
                                     [](const VtiArray& array) { return array.components == 1; });
    if (single != header.arrays.end()) {
      return VtiChoice{*single, 0};  // its type is refused later, by name
    }
    return WithoutChoice(header, header.arrays.front(), path);
  }
  const VtiArray* found = FindNamed(header, part);
  if (found != nullptr) {
    return found->components == 1 ? absl::StatusOr<VtiChoice>(VtiChoice{*found, 0})
                                  : WithoutChoice(header, *found, path);
  }
  const std::size_t colon = part.rfind(':');
  std::int64_t component = -1;
  if (colon != std::string::npos && absl::SimpleAtoi(part.substr(colon + 1), &component)) {
    found = FindNamed(header, part.substr(0, colon));
  }
  if (found == nullptr) {
    return absl::NotFoundError(
        absl::StrFormat("%s: no array \"%s\"; it holds %s", path, part, Listed(header)));
  }
  if (component < 0 || component >= found->components) {
    return WithoutChoice(header, *found, path);
  }
  return VtiChoice{*found, component};
}

absl::StatusOr<volume::ScalarType> VtiTypeOf(const VtiArray& array, const std::string& path) {
  const KnownType* known = FindType(array.type);
  if (known == nullptr) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: array \"%s\" is of type \"%s\"; expected (U)Int8, (U)Int16, (U)Int32, Float32 or "
        "Float64",
        path, array.name, array.type));
  }
  return known->type;
}

bool IsVtiNumber(const std::string& type) {
  return FindType(type) != nullptr || type == "Int64" || type == "UInt64";
}
}  // namespace isoscope::source
