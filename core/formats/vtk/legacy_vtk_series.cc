// The parser (legacy_vtk_parser.h) finds all arrays. Here they become fields: those of points, or
// of cells if there is none of points. All fields of a file have one grid. Names of components
// count only if each has one of its own; else components are called x, y and z, or by their
// numbers.

#include "core/formats/vtk/legacy_vtk_series.h"

#include <algorithm>
#include <cstddef>
#include <memory>
#include <set>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"
#include "core/formats/vtk/legacy_vtk_parser.h"
#include "core/io/file.h"
#include "core/source/bytes/located_series.h"
#include "core/source/grid/cf_grid.h"
#include "core/source/series_parts.h"

namespace isoscope::source {
namespace {

SourceField LegacyFieldOf(const LegacyVtkArray& array) {
  SourceField field{.name = array.name,
                    .long_name = array.is_of_cells
                                     ? absl::StrCat(array.name, " (of cells, at their centres)")
                                     : "",
                    .unit = array.unit,
                    .components = ComponentNames(array.components)};
  const std::set<std::string> distinct(array.component_names.begin(), array.component_names.end());
  if (array.components > 1 && distinct.size() == static_cast<std::size_t>(array.components) &&
      !distinct.contains("magnitude") && !distinct.contains("")) {
    field.components = array.component_names;
  }
  return field;
}

FieldLocation LocateLegacyArray(const LegacyVtkArray& array, const std::string& path,
                                bool is_binary) {
  if (is_binary) {
    return {.location = SampleLocation{.files = {path},
                                       .offset = array.offset,
                                       .has_more_behind = true,
                                       .is_big_endian = true,
                                       .stored_type = array.type,
                                       .components = array.components},
            .wide = array.wide};
  }
  return {.location = TextLocation{.file = path,
                                   .offset = array.offset,
                                   .type = array.type,
                                   .wide = array.wide,
                                   .components = array.components}};
}

absl::StatusOr<LocatedFile> LocateLegacyVtk(const LegacyVtkFile& file, const std::string& path,
                                            const GridRules& rules) {
  const bool has_points =
      std::any_of(file.arrays.begin(), file.arrays.end(),
                  [](const LegacyVtkArray& array) { return !array.is_of_cells; });
  LocatedFile located{.info = {.name = path}};
  ISOSCOPE_ASSIGN_OR_RETURN(CfUnevenGrid grid, file.grid.Locate(!has_points, rules));
  located.geometry = grid.geometry;
  located.distances = std::move(grid.distances);
  located.fill = rules.fill;
  if (file.time.has_value()) {
    located.info.times = {*file.time};
  }
  std::set<std::string> names;
  for (const LegacyVtkArray& array : file.arrays) {
    if (array.is_of_cells == has_points) {
      continue;
    }
    if (!names.insert(array.name).second) {
      return absl::InvalidArgumentError(
          absl::StrFormat("two arrays are called \"%s\"", array.name));
    }
    located.Add(LegacyFieldOf(array), LocateLegacyArray(array, path, file.is_binary));
  }
  if (located.locations.empty()) {
    return absl::InvalidArgumentError("no array of numbers in its POINT_DATA or CELL_DATA");
  }
  return located;
}

absl::StatusOr<LocatedFile> ParseAndLocate(const io::RandomAccessFile& file,
                                           const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(const LegacyVtkFile parsed, ParseLegacyVtk(file));
  return LocateLegacyVtk(parsed, file.path(), rules);
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenLegacyVtkSeries(const std::string& file,
                                                                  const std::string& /*field*/,
                                                                  const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> opened,
                            io::OpenRandomAccessFile(file));
  auto located = ParseAndLocate(*opened, rules);
  if (!located.ok()) {
    return absl::Status(located.status().code(),
                        absl::StrCat(file, ": ", located.status().message()));
  }
  return MakeLocatedSeries(*std::move(located));
}

}  // namespace isoscope::source
