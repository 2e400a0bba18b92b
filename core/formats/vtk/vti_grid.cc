#include "core/formats/vtk/vti_grid.h"

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"
#include "core/source/grid/grid_faults.h"

namespace isoscope::source {
absl::StatusOr<VtkExtent> WholeVtiExtent(const VtiHeader& header, const std::string& path) {
  const auto found = header.image.find("WholeExtent");
  const std::string text = found == header.image.end() ? "" : found->second;
  ISOSCOPE_ASSIGN_OR_RETURN(const VtkExtent extent, ParseVtkExtent(text, "WholeExtent", path));
  ISOSCOPE_ASSIGN_OR_RETURN(const VtkExtent piece,
                            ParseVtkExtent(header.piece_extent, "Extent", path));
  if (piece != extent) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: its first piece is %s of %s; expected all of it in one piece", path,
                        header.piece_extent, text));
  }
  return extent;
}

absl::StatusOr<volume::GridGeometry> VtiGeometry(const VtiHeader& header, bool is_of_cells,
                                                 const std::string& path, const GridRules& rules) {
  if (!header.is_image) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": a RectilinearGrid; expected ImageData: rename it to end in .vtr"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const VtkExtent extent, WholeVtiExtent(header, path));
  ISOSCOPE_ASSIGN_OR_RETURN(volume::GridGeometry geometry,
                            VtkGridOf(header.image, extent, is_of_cells, path));
  ISOSCOPE_RETURN_IF_ERROR(TakeGridByRules(path, rules, &geometry));
  const absl::Status valid = volume::Validate(geometry);
  if (!valid.ok()) {
    return absl::Status(
        valid.code(),
        absl::StrCat(path, is_of_cells ? ": the centres of its cells: " : ": ", valid.message()));
  }
  return geometry;
}
}  // namespace isoscope::source
