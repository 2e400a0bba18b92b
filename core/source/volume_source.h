// A source volume, read in z-slabs.

#ifndef ISOSCOPE_CORE_SOURCE_VOLUME_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_VOLUME_SOURCE_H_

#include <cstdint>
#include <optional>
#include <string>

#include "absl/status/status.h"

#include "core/volume/grid_geometry.h"
#include "core/volume/patient_frame.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

// Thread-compatible.
class VolumeSource {
 public:
  virtual ~VolumeSource() = default;

  [[nodiscard]] virtual const volume::GridGeometry& geometry() const = 0;
  [[nodiscard]] virtual volume::ScalarType scalar_type() const = 0;
  // The meaning of the world axes on the patient; not set if the file does not say.
  [[nodiscard]] virtual std::optional<volume::PatientFrame> patient_frame() const {
    return std::nullopt;
  }
  // Path or name, for messages.
  [[nodiscard]] virtual const std::string& name() const = 0;
  // A sentence without its end, for people: how the grid differs from that of the file. Empty: it
  // does not.
  [[nodiscard]] virtual std::string note() const { return ""; }
  // True if samples are interpolated between those of the file, with holes for GridRules::fill.
  [[nodiscard]] virtual bool is_resampled() const { return false; }

  // Reads rows [begin_row, end_row), row = z * ny + y, as [row][x], x fastest, little-endian, into
  // `out`, which holds (end_row - begin_row) * nx * SizeOf(type) bytes. Runs of rows may overlap;
  // they are asked for in ascending order of begin_row within a pass, unless is_seekable(); a pass
  // may start over at 0. Memory beside `out`: memory_bytes(), however many rows.
  // INVALID_ARGUMENT if the file ends early (names bytes expected and found), DATA_LOSS if it is
  // damaged or can't be decoded.
  // REQUIRES: 0 <= begin_row < end_row <= ny * nz.
  virtual absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) = 0;

  // True if rows in any order cost no more than in ascending order.
  [[nodiscard]] virtual bool is_seekable() const { return true; }
  // Memory while it is read, for the memory limit.
  [[nodiscard]] virtual std::int64_t memory_bytes() const { return 0; }

  // Reads planes [begin_z, end_z).
  absl::Status ReadSlab(std::int64_t begin_z, std::int64_t end_z, char* out) {
    const std::int64_t rows = geometry().sample_dims.y;
    return ReadRows(begin_z * rows, end_z * rows, out);
  }
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_VOLUME_SOURCE_H_
