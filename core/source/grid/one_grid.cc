#include "core/source/grid/one_grid.h"

#include "absl/strings/str_format.h"

namespace isoscope::source {
namespace {

std::string Described(const volume::GridGeometry& grid, int digits) {
  const math::Index3& dims = grid.sample_dims;
  const math::Vec3d& spacing = grid.spacing;
  const math::Vec3d& origin = grid.origin;
  return absl::StrFormat("%d x %d x %d samples, %.*g x %.*g x %.*g apart, from (%.*g, %.*g, %.*g)",
                         dims.x, dims.y, dims.z, digits, spacing.x, digits, spacing.y, digits,
                         spacing.z, digits, origin.x, digits, origin.y, digits, origin.z);
}

}  // namespace

absl::Status CheckOneGrid(const std::string& place, const volume::GridGeometry& grid,
                          const std::string& first, const volume::GridGeometry& first_grid) {
  constexpr int kShort = 6;
  constexpr int kExact = 17;
  if (grid == first_grid) {
    return absl::OkStatus();
  }
  const int digits = Described(grid, kShort) == Described(first_grid, kShort) ? kExact : kShort;
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: %s%s; the first step, %s, has %s: all steps must lie on one grid", place,
                      Described(grid, digits),
                      grid.direction == first_grid.direction ? "" : ", along other directions",
                      first, Described(first_grid, digits)));
}

}  // namespace isoscope::source
