// The grid of a legacy VTK file: structured points, or a rectilinear grid (legacy_vtk_parser.h).

#ifndef ISOSCOPE_CORE_FORMATS_VTK_LEGACY_VTK_GRID_H_
#define ISOSCOPE_CORE_FORMATS_VTK_LEGACY_VTK_GRID_H_

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"

#include "core/formats/vtk/legacy_vtk_words.h"
#include "core/math/vec.h"
#include "core/source/grid/cf_grid.h"
#include "core/source/grid/grid_rules.h"
#include "core/source/grid/rectilinear_grid.h"

namespace isoscope::source {

class LegacyGrid {
 public:
  void SetRectilinear() { is_rectilinear_ = true; }
  // The numbers of points; 0 until they are known.
  [[nodiscard]] const math::Index3& dims() const { return dims_; }

  // Takes all behind a keyword of the grid, such as DIMENSIONS; false if it is no such keyword.
  // INVALID_ARGUMENT: a word that is no number, or too many numbers.
  absl::StatusOr<bool> Take(const std::string& keyword, bool is_binary, LegacyWords* words);

  // The grid of the points, or of the cells' centres, with distances only if it is uneven and the
  // rules resample. INVALID_ARGUMENT: not as many coordinates as DIMENSIONS say; as
  // RectilinearGridOf and TakeGridByRules.
  [[nodiscard]] absl::StatusOr<CfUnevenGrid> Locate(bool is_of_cells, const GridRules& rules) const;

 private:
  absl::Status TakeCoordinates(std::size_t axis, bool is_binary, LegacyWords* words);

  bool is_rectilinear_ = false;
  math::Index3 dims_;
  math::Vec3d origin_;
  math::Vec3d spacing_{1, 1, 1};
  RectilinearAxes axes_{};
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_VTK_LEGACY_VTK_GRID_H_
