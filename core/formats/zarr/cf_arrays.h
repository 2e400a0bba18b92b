// Arrays of a group with the coordinates of their axes, by the CF conventions as xarray writes them:
// an array of one axis, with the name of that axis, has its coordinates.

#ifndef ISOSCOPE_CORE_FORMATS_ZARR_CF_ARRAYS_H_
#define ISOSCOPE_CORE_FORMATS_ZARR_CF_ARRAYS_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/formats/zarr/zarr_metadata.h"
#include "core/formats/zarr/zarr_store.h"
#include "core/source/grid/cf_grid.h"

namespace isoscope::source {

struct CfArray {
  ZarrArray array{};
  std::vector<CfAxis> axes{};
  CfRoles roles{};
  std::vector<std::string> coordinates{};  // paths of their arrays
};

// The axes of an array of the group. Coordinates that can't be read are the fault of their axis, as
// are those that depend on several axes. Errors of reading them.
absl::StatusOr<CfArray> DescribeCfArray(ZarrStore* store, const std::string& group,
                                        ZarrArray array);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_ZARR_CF_ARRAYS_H_
