// Where the samples of an HDF5 dataset lie, as its file says it: NeXus, dimension scales, names of
// axes. Calls the library: for the process that it runs in (walled_source.h).

#ifndef ISOSCOPE_CORE_FORMATS_HDF5_HDF5_COORDINATES_H_
#define ISOSCOPE_CORE_FORMATS_HDF5_HDF5_COORDINATES_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/formats/hdf5/hdf5_dataset.h"
#include "core/source/adapt/resampled_source.h"
#include "core/source/grid/axis_order.h"
#include "core/source/grid/cf_grid.h"
#include "core/source/grid/grid_rules.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::source {

// Returns the axes of a dataset, slowest first. Names and coordinates are those of the NeXus plot
// to which the dataset belongs, else those of its dimension scales. A name alone may also stand in
// DIMENSION_LABELS, `axes` or `axistags`. Borders between samples (one number more than samples)
// become middles; NeXus may scale coordinates. INVALID_ARGUMENT: coordinates of another length, or
// of several axes (names them); values that NeXus scales.
absl::StatusOr<std::vector<CfAxis>> Hdf5AxesOf(const NamedHdf5Dataset& named);

// The meaning of each axis.
struct Hdf5Layout {
  AxisOrder order;  // for reading: z is the slowest axis of space, x the fastest
  CfRoles roles;    // for positions: along which axis of the world each of them runs
};
// `letters`, one for each axis, decide (axis_order.h). If there are none: names, if they say it of
// all axes of more than one element; else, of three such axes or of three axes, the slowest is z.
// INVALID_ARGUMENT: letters that do not fit; nothing says it (lists the choices, and a command for
// the path `name`). The message is to follow a name and a colon.
absl::StatusOr<Hdf5Layout> Hdf5LayoutOf(const std::vector<CfAxis>& axes, const std::string& letters,
                                        const std::string& name);

// The grid of the samples. An axis without coordinates has the spacing of the attribute
// "element_size_um", else 1 (cf_grid.h). INVALID_ARGUMENT: an axis that is not even, unless
// `takes_uneven`; such an attribute without three distances, unless the rules have others;
// otherwise as CfGridOf.
struct Hdf5Grid {
  volume::GridGeometry geometry;
  AxisDistances distances;
  std::string length_unit;
};
absl::StatusOr<Hdf5Grid> Hdf5GridOf(const NamedHdf5Dataset& named, const std::vector<CfAxis>& axes,
                                    const CfRoles& roles, bool takes_uneven,
                                    const GridRules& rules = {});

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_HDF5_HDF5_COORDINATES_H_
