// All that a header says of the volumes of a file, whatever the format.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_FILE_LAYOUT_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_FILE_LAYOUT_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/source/adapt/rescale.h"
#include "core/source/adapt/wide_source.h"
#include "core/source/bytes/sample_location.h"
#include "core/source/grid/affine_grid.h"
#include "core/source/grid/grid_faults.h"
#include "core/source/grid/grid_rules.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/patient_frame.h"

namespace isoscope::source {

// A plane of samples that lies by itself.
struct StoredSlice {
  std::int64_t offset = 0;  // in the file, bytes
  Rescaling rescaling{};
};

// The volumes are numbered (field * components + component) * steps + step.
struct FileLayout {
  volume::GridGeometry geometry{};
  std::optional<Shear> shear{};  // of the geometry, where the format should have none
  GridFaults faults{};           // what the header lacks of the geometry
  std::optional<volume::PatientFrame> patient_frame{};
  SampleLocation location{};  // with the number of volumes and components of a tuple
  std::optional<WideType> wide{};
  std::vector<std::string> fields{};  // names, unique; empty: one, of the name that Make... gets
  std::int64_t components = 1;
  std::int64_t steps = 1;
  double first_time = 0;  // of step 0; step i has first_time + i * interval
  double interval = 1;
  std::vector<double> times{};  // by step, in place of these two
  std::string time_unit{};
  std::string length_unit{};
  std::string sample_unit{};
  // One for each volume; empty: as the location says. If one is not 1 and 0, all are rescaled.
  std::vector<Rescaling> rescalings{};
  // The planes of all volumes, z fastest, in the only file of the location; empty: as the location
  // says. They take the place of `rescalings`, too.
  std::vector<StoredSlice> slices{};

  [[nodiscard]] std::int64_t volume_count() const {
    return static_cast<std::int64_t>(fields.empty() ? 1 : fields.size()) * components * steps;
  }
};

// A series of these volumes; `path` is for messages, `field` the name of the only field.
// INVALID_ARGUMENT: more than 100 000 steps, 1000 fields or 4096 components; times that are not
// finite, or not above those before; a shear, or faults, unless the rules take them.
absl::StatusOr<std::unique_ptr<VolumeSeries>> MakeLayoutSeries(const std::string& path,
                                                               const std::string& field,
                                                               FileLayout layout,
                                                               const GridRules& rules = {});

// One of these volumes. Errors as MakeFileSource. REQUIRES: the number is in range.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenLayoutVolume(const FileLayout& layout,
                                                               std::int64_t volume,
                                                               const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_FILE_LAYOUT_H_
