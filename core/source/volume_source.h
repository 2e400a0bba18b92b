// A source volume, read in z-slabs.

#ifndef ISOSCOPE_CORE_SOURCE_VOLUME_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_VOLUME_SOURCE_H_

#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

#include "core/base/cancellation.h"
#include "core/math/box.h"
#include "core/math/vec.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/patient_frame.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

// All that a source says of its volume beside the samples. A source that is made of another copies
// the info of the inner source, and changes what it changes.
struct SourceInfo {
  std::string name{};  // path or name, for messages
  volume::GridGeometry geometry{};
  volume::ScalarType type = volume::ScalarType::kUint8;
  // The meaning of the world axes on the patient; not set if the file does not say.
  std::optional<volume::PatientFrame> patient_frame{};
  // A sentence without its end, for people: how the grid differs from that of the file. Empty: it
  // does not.
  std::string note{};
  // Samples are interpolated between those of the file, with holes for GridRules::fill.
  bool is_resampled = false;
  bool is_seekable = true;        // rows in any order cost no more than in ascending order
  std::int64_t memory_bytes = 0;  // while it is read, for the memory limit
  // Planes [k * n, (k + 1) * n) cost no more together than one of them alone: those of a layer of
  // chunks. 1: each plane costs the same.
  std::int64_t planes_at_once = 1;

  [[nodiscard]] std::int64_t row_bytes() const {
    return geometry.sample_dims.x * static_cast<std::int64_t>(volume::SizeOf(type));
  }

  friend bool operator==(const SourceInfo&, const SourceInfo&) = default;
};

// The division of a volume into boxes that are read and decoded as one, such as the chunks of a
// file. Boxes at the border reach beyond the volume.
struct BoxGrid {
  math::Index3 origin{0, 0, 0};  // the first sample of the first box; -box_dims < origin <= 0
  math::Index3 box_dims{1, 1, 1};

  friend bool operator==(const BoxGrid&, const BoxGrid&) = default;
};

// Thread-compatible, but for ReadBox.
class VolumeSource {
 public:
  virtual ~VolumeSource() = default;

  [[nodiscard]] const SourceInfo& info() const { return info_; }

  // Reads rows [begin_row, end_row), row = z * ny + y, as [row][x], x fastest, little-endian, into
  // `out`, which holds (end_row - begin_row) * nx * SizeOf(type) bytes. Runs of rows may overlap;
  // they are asked for in ascending order of begin_row within a pass, unless it is_seekable; a pass
  // may start over at 0. Memory beside `out`: memory_bytes, however many rows.
  // INVALID_ARGUMENT if the file ends early (names bytes expected and found), DATA_LOSS if it is
  // damaged or can't be decoded.
  // REQUIRES: 0 <= begin_row < end_row <= ny * nz.
  virtual absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) = 0;

  // Reads rows [begin_y, end_y) of planes [begin_z, end_z), as [z][y][x]: what ReadRows reads plane
  // after plane, unless a source can do better. Errors and requirements as of ReadRows.
  virtual absl::Status ReadBand(std::int64_t begin_z, std::int64_t end_z, std::int64_t begin_y,
                                std::int64_t end_y, char* out) {
    const std::int64_t rows = info_.geometry.sample_dims.y;
    for (std::int64_t z = begin_z; z < end_z; ++z) {
      absl::Status status = ReadRows(z * rows + begin_y, z * rows + end_y, out);
      if (!status.ok()) {
        return status;
      }
      out += (end_y - begin_y) * info_.row_bytes();
    }
    return absl::OkStatus();
  }

  // From now on a read that may take long, as at an address, ends soon after that cancellation with
  // its error. Null: no more. A source that is made of others hands it on to them. The cancellation
  // must live until another one takes its place (CancellableReads).
  virtual void HeedCancellation(const base::Cancellation* /*cancellation*/) {}

  // Reads planes [begin_z, end_z).
  absl::Status ReadSlab(std::int64_t begin_z, std::int64_t end_z, char* out) {
    const std::int64_t rows = info_.geometry.sample_dims.y;
    return ReadRows(begin_z * rows, end_z * rows, out);
  }

  // The boxes in which ReadBox reads best. Not set: it can't read, because the samples come only
  // in their order, or from several places.
  [[nodiscard]] virtual std::optional<BoxGrid> box_grid() const { return std::nullopt; }
  // ReadBox of n bytes of samples takes the memory of decoding so many times n; at least 1.
  [[nodiscard]] virtual std::int64_t decoding_factor() const { return 1; }
  // Reads the samples of any box as [z][y][x], x fastest, little-endian, into `out`. The same
  // samples and errors as ReadRows; that of `cancellation` soon after it fires, if the read takes
  // long. Thread-safe, also beside ReadRows. Each box that the grid has is read and decoded again by
  // each call that meets it.
  // REQUIRES: box_grid() is set; the box lies in the volume, and is not empty.
  [[nodiscard]] virtual absl::Status ReadBox(const math::IndexBox& /*box*/, char* /*out*/,
                                             const base::Cancellation& /*cancellation*/) const {
    return absl::UnimplementedError(absl::StrCat(info_.name, ": has no random access"));
  }

 protected:
  explicit VolumeSource(SourceInfo info) : info_(std::move(info)) {}

 private:
  SourceInfo info_;
};

// While it lives, reads of a source heed a cancellation. Both must outlive it.
class CancellableReads {
 public:
  CancellableReads(VolumeSource* source, const base::Cancellation& cancellation)
      : source_(*source) {
    source_.HeedCancellation(&cancellation);
  }
  ~CancellableReads() { source_.HeedCancellation(nullptr); }
  CancellableReads(const CancellableReads&) = delete;
  CancellableReads& operator=(const CancellableReads&) = delete;

 private:
  VolumeSource& source_;
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_VOLUME_SOURCE_H_
