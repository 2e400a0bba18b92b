// The fields of the grid, with their other names:
//
//   DimSize = 64 64 93
//   ElementSpacing = 0.5 0.5 2          distances of samples; ElementSize, of voxels, in its place
//   Offset = -10 -20 30                 of the first sample; or Position, or Origin
//   TransformMatrix = 1 0 0 0 1 0 0 0 1 direction of x, of y, of z; or Rotation, or Orientation
//
// CenterOfRotation and AnatomicalOrientation are passed over, as in ITK. Source:
// https://itk.org/Wiki/ITK/MetaIO/Documentation; MetaIO's metaObject.cxx and metaImage.cxx.

#include "core/formats/medical/meta_image_grid.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"

#include "core/base/status_macros.h"
#include "core/source/grid/grid_faults.h"
#include "core/source/grid/sample_distance.h"

namespace isoscope::source {
namespace {

struct MetaField {
  const char* key;   // in lower case
  const char* name;  // as it is written
};

// The numbers of the first of these fields that there is, and which that is; none if there is none.
// INVALID_ARGUMENT: not `count` finite numbers; another of the fields has others.
absl::StatusOr<std::vector<double>> MetaNumbers(const HeaderFields& fields,
                                                const std::vector<MetaField>& names,
                                                std::size_t count, const std::string& path,
                                                std::string* used) {
  std::vector<double> found;
  for (const MetaField& field : names) {
    const std::string text = fields.Get(field.key);
    if (text.empty()) {
      continue;
    }
    std::vector<double> numbers;
    bool is_good = true;
    for (const absl::string_view word :
         absl::StrSplit(text, absl::ByAnyChar(" \t,"), absl::SkipEmpty())) {
      is_good = is_good && absl::SimpleAtod(word, &numbers.emplace_back());
    }
    if (!is_good || numbers.size() != count) {
      return absl::InvalidArgumentError(absl::StrFormat("%s: %s = %s; expected %d numbers", path,
                                                        field.name, text.substr(0, 200), count));
    }
    if (!found.empty() && numbers != found) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: %s = %s, but %s has other numbers; expected one of both", path,
                          field.name, text.substr(0, 200), *used));
    }
    if (found.empty()) {
      *used = field.name;
      found = std::move(numbers);
    }
  }
  return found;
}

bool AreFinite(const std::vector<double>& numbers) {
  return std::all_of(numbers.begin(), numbers.end(),
                     [](double number) { return std::isfinite(number); });
}

std::string NotFinite(const std::string& name, const std::vector<double>& numbers) {
  return absl::StrCat(name, " = ", absl::StrJoin(numbers, " "));
}

absl::Status SetMetaSpacing(const HeaderFields& fields, std::size_t axes, const std::string& path,
                            volume::GridGeometry* geometry, GridFaults* faults) {
  std::string name;
  ISOSCOPE_ASSIGN_OR_RETURN(
      std::vector<double> spacing,
      MetaNumbers(fields, {{"elementspacing", "ElementSpacing"}}, axes, path, &name));
  if (spacing.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        spacing, MetaNumbers(fields, {{"elementsize", "ElementSize"}}, axes, path, &name));
  }
  for (std::size_t axis = 0; axis < 3 && !spacing.empty(); ++axis) {
    const absl::Status good = CheckSampleDistance(
        path, absl::StrFormat("number %d of %s", axis + 1, name), spacing[axis]);
    faults->distances.Update(good);
    geometry->spacing[static_cast<int>(axis)] = good.ok() ? spacing[axis] : 1;
  }
  return absl::OkStatus();
}

absl::Status SetMetaDirections(const HeaderFields& fields, std::size_t axes,
                               const std::string& path, volume::GridGeometry* geometry,
                               GridFaults* faults) {
  std::string name;
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> matrix,
                            MetaNumbers(fields,
                                        {{"transformmatrix", "TransformMatrix"},
                                         {"rotation", "Rotation"},
                                         {"orientation", "Orientation"}},
                                        axes * axes, path, &name));
  if (!AreFinite(matrix)) {
    faults->directions.Update(NoDirections(path, NotFinite(name, matrix)));
    return absl::OkStatus();
  }
  for (std::size_t from = 0; from < axes && !matrix.empty(); ++from) {
    for (std::size_t to = 0; to < axes; ++to) {
      const double number = matrix[from * axes + to];
      if (from < 3 && to < 3) {
        geometry->direction.columns[from][static_cast<int>(to)] = number;
      } else if (from != to && number != 0) {
        return absl::InvalidArgumentError(
            absl::StrFormat("%s: %s mixes axis %d with axis %d (%g); expected that of space alone",
                            path, name, from + 1, to + 1, number));
      }
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<volume::GridGeometry> ReadMetaImageGrid(const std::string& path,
                                                       const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(const HeaderFields fields, ReadMetaImageFields(path));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::int64_t> sizes, fields.GetIntegers("dimsize"));
  const std::size_t axes = sizes.size();
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t named, fields.GetInteger("ndims", 0));
  if (axes < 3 || named != static_cast<std::int64_t>(axes)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d-dimensional (NDims = %d, DimSize = %s); expected three axes of 2 "
                        "samples or more, as many as NDims says",
                        path, axes, named, fields.Get("dimsize")));
  }
  volume::GridGeometry geometry;
  geometry.sample_dims = {sizes[0], sizes[1], sizes[2]};
  GridFaults faults;
  ISOSCOPE_RETURN_IF_ERROR(SetMetaSpacing(fields, axes, path, &geometry, &faults));
  ISOSCOPE_RETURN_IF_ERROR(SetMetaDirections(fields, axes, path, &geometry, &faults));
  std::string name;
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::vector<double> origin,
      MetaNumbers(fields, {{"offset", "Offset"}, {"position", "Position"}, {"origin", "Origin"}},
                  axes, path, &name));
  if (!AreFinite(origin)) {
    faults.origin.Update(NoOrigin(path, NotFinite(name, origin)));
  } else if (!origin.empty()) {
    geometry.origin = {origin[0], origin[1], origin[2]};
  }
  ReplaceFaults(path, &geometry, &faults);
  ISOSCOPE_RETURN_IF_ERROR(faults.Check(rules, path));
  const absl::Status valid = volume::Validate(geometry);
  if (!valid.ok()) {
    return absl::Status(valid.code(), absl::StrCat(path, ": ", valid.message()));
  }
  return geometry;
}

}  // namespace isoscope::source
