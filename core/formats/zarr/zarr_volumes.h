// The arrays of a store that are volumes of one grid: those of an image of OME-Zarr, or of a group
// by the CF conventions (xarray), or arrays that say nothing of their axes.

#ifndef ISOSCOPE_CORE_FORMATS_ZARR_ZARR_VOLUMES_H_
#define ISOSCOPE_CORE_FORMATS_ZARR_ZARR_VOLUMES_H_

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/formats/zarr/zarr_metadata.h"
#include "core/formats/zarr/zarr_packing.h"
#include "core/formats/zarr/zarr_source.h"
#include "core/formats/zarr/zarr_store.h"
#include "core/source/grid/axis_distances.h"
#include "core/source/grid/grid_rules.h"
#include "core/source/volume_series.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/label.h"

namespace isoscope::source {

struct ZarrField {
  SourceField field{};
  ZarrArray array{};
  ZarrPart part{};  // its index has 0 for steps and components
  std::optional<std::size_t> time{};
  std::optional<std::size_t> component{};
  // An error for whoever opens a volume of the field.
  absl::StatusOr<ZarrPacking> packing = ZarrPacking();
};

struct ZarrVolumes {
  SeriesInfo info{};
  std::vector<ZarrField> fields{};  // as info.fields
  // An error for whoever opens a volume.
  absl::StatusOr<volume::GridGeometry> geometry = absl::UnknownError("no grid");
  AxisDistances distances{};          // of a grid that is not even, if the rules resample
  std::string note{};                 // as SourceInfo::note
  std::string left_out{};             // which arrays of the group are, if none was asked for
  std::vector<std::string> arrays{};  // paths of all that decide samples or positions
};

struct ZarrChoice {
  std::string path{};  // of a group, or an array; "" for the root
  std::string axes{};  // letters of --axes, for arrays; "": the file says them
  GridRules rules{};
};

// INVALID_ARGUMENT: no volume at the path (says what there is), or several on different grids
// without a choice; an axis that is not even, unless the rules resample; as CfGridOf, OmeGridOf,
// ZarrPackingOf; times that do not ascend; more than 100 000 steps or 4096 components. NOT_FOUND:
// no such path.
absl::StatusOr<ZarrVolumes> FindZarrVolumes(ZarrStore* store, const ZarrChoice& choice);
// The names and colours of the values of a label image, a group or a level of it; none for others.
// INVALID_ARGUMENT: a table that makes no sense; the samples may be read all the same. NOT_FOUND: no
// such path.
absl::StatusOr<std::vector<volume::Label>> FindZarrLabels(ZarrStore* store,
                                                          const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_ZARR_ZARR_VOLUMES_H_
