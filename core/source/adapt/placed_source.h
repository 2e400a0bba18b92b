// A volume at other world positions than those of its file: --spacing, --origin, --direction.

#ifndef ISOSCOPE_CORE_SOURCE_ADAPT_PLACED_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_ADAPT_PLACED_SOURCE_H_

#include <memory>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/math/matrix.h"
#include "core/math/vec.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::source {

// The members that take the place of the file's grid; not set: as the file has it.
struct GridOverride {
  std::optional<math::Vec3d> spacing{};  // world units between samples, > 0
  std::optional<math::Vec3d> origin{};   // world position of the first sample of the file
  // Columns: the world directions of the axes x, y and z, of length 1 and at right angles.
  std::optional<math::Mat3d> direction{};

  [[nodiscard]] bool is_none() const { return !spacing && !origin && !direction; }

  friend bool operator==(const GridOverride&, const GridOverride&) = default;
};

// INVALID_ARGUMENT: numbers that are not finite; a spacing of 0 or less; directions that leave
// length 1 or right angles (a cosine of 0) by more than 0.0003, the tolerance of FindShear.
absl::Status Validate(const GridOverride& grid);

// The grid with what takes its place. `name` is for messages. INVALID_ARGUMENT: Validate; a grid
// whose positions 32-bit floats do not carry.
absl::StatusOr<volume::GridGeometry> PlacedGrid(const volume::GridGeometry& geometry,
                                                const GridOverride& grid, const std::string& name);

// The samples at the positions of `geometry`, which has the same dimensions.
std::unique_ptr<VolumeSource> MoveSource(std::unique_ptr<VolumeSource> source,
                                         const volume::GridGeometry& geometry);

// Positions change, and the note tells from what; samples and patient frame stay.
// INVALID_ARGUMENT: PlacedGrid; a spacing for a source that is_resampled, whose distances are those
// of the file.
absl::StatusOr<std::unique_ptr<VolumeSource>> PlaceSource(std::unique_ptr<VolumeSource> source,
                                                          const GridOverride& grid);
// Does so with each volume that is opened. Errors of Open: as PlaceSource.
std::unique_ptr<VolumeSeries> PlaceSeries(std::unique_ptr<VolumeSeries> series,
                                          const GridOverride& grid);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_ADAPT_PLACED_SOURCE_H_
