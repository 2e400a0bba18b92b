// OpenVDB files with known voxels, written by the library.

#ifndef ISOSCOPE_TESTS_SUPPORT_VDB_FILE_H_
#define ISOSCOPE_TESTS_SUPPORT_VDB_FILE_H_

#include <array>
#include <string>
#include <vector>

#include "core/math/vec.h"

namespace isoscope::testing {

// Sets a box of voxels.
struct VdbFill {
  math::Index3 begin;
  math::Index3 end;
  double value = 0;
  bool is_active = true;
  // Voxels have VdbPattern(value, ...) of their own; else the box is filled by tiles where it can.
  bool has_pattern = false;
};

// From `value` on, 0 to 99 more.
double VdbPattern(double value, const math::Index3& at);

struct VdbFileGrid {
  std::string name = "density";
  // float, half, double, int32, int64, bool, mask, vec3f, vec3d, vec3i; points, which are not read.
  std::string type = "float";
  double background = 0;  // of a vector: of each component
  std::vector<VdbFill> fills{};
  // Rows: world[r] = rows[r][0] x + rows[r][1] y + rows[r][2] z + rows[r][3].
  std::array<std::array<double, 4>, 3> world{{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
  bool is_frustum = false;
  bool is_level_set = false;
};

// The value of component `component` of a voxel, and whether it is active, as fills in their order
// leave them. Component c of a vector is larger than the first by c.
struct VdbVoxel {
  double value = 0;
  bool is_active = false;
};
VdbVoxel VdbVoxelAt(const VdbFileGrid& grid, const math::Index3& at, int component);

// `is_stream`: without the places of its grids, as a pipe has it.
void WriteVdbFile(const std::string& path, const std::vector<VdbFileGrid>& grids,
                  bool is_stream = false);

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_VDB_FILE_H_
