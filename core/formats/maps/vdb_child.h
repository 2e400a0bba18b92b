// OpenVDB files by libopenvdb, in the module isoscope_vdb.so. It is loaded and runs in a child
// process (walled_source.h), because hostile bytes may crash the library.

#ifndef ISOSCOPE_CORE_FORMATS_MAPS_VDB_CHILD_H_
#define ISOSCOPE_CORE_FORMATS_MAPS_VDB_CHILD_H_

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/math/vec.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

struct VdbGrid {
  std::string name;        // unique in the file: "density", "density[1]"; "[0]": it has none
  std::string type;        // the library's name of its tree: "Tree_float_5_4_3"
  int components = 0;      // 1 or 3; 0: such values are not read
  std::string grid_class;  // "level set", "fog volume", "staggered"; "unknown"
  bool is_linear = false;  // else it is a frustum, say
  std::int64_t alike = 0;  // the first grid that has the same transform
};

// One component of the samples in the box of the active voxels of a grid, or of a file.
class VdbVolume {
 public:
  struct Header {
    volume::ScalarType type = volume::ScalarType::kFloat32;
    bool is_int64 = false;  // the type is float64, in place of the bits of integers
    math::Index3 dims;
    // Rows: world[r] = rows[r][0] x + rows[r][1] y + rows[r][2] z + rows[r][3], of indices in the
    // box.
    std::array<std::array<double, 4>, 3> world_from_index{};
    std::int64_t memory_bytes = 0;  // the tree, and the values of one layer of its leaves
  };

  virtual ~VdbVolume() = default;
  [[nodiscard]] virtual const Header& header() const = 0;
  // As VolumeSource::ReadRows.
  virtual absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) = 0;
};

// The calls of the module. Both may crash, hang, or take all memory.
struct VdbModule {
  // All grids, without their voxels. INVALID_ARGUMENT: more grids, or longer names, than a file
  // should have, or a type that the library does not know. DATA_LOSS: no OpenVDB file, or a damaged
  // one.
  absl::StatusOr<std::vector<VdbGrid>> (*list)(const std::string& path);
  // Grid `grid` of that list. `is_joined`: the box is that around the active voxels of all grids
  // that can be read and have its transform. INVALID_ARGUMENT: the grid can't be read, its
  // transform is not linear, or no voxel is active. DATA_LOSS.
  absl::StatusOr<std::unique_ptr<VdbVolume>> (*open)(const std::string& path, std::int64_t grid,
                                                     std::int64_t component, bool is_joined);
};

const VdbModule& VdbCalls();

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_MAPS_VDB_CHILD_H_
