// The header of a NumPy array (.npy): its type, its shape and its order.

#ifndef ISOSCOPE_CORE_FORMATS_ARRAYS_NPY_HEADER_H_
#define ISOSCOPE_CORE_FORMATS_ARRAYS_NPY_HEADER_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/adapt/wide_source.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

// This number of bytes holds any header that is read.
inline constexpr std::size_t kNpyHeadBytes = std::size_t{64} * 1024 + 12;

struct NpyHeader {
  volume::ScalarType type = volume::ScalarType::kUint8;  // of `wide`, its carrier; bool is uint8
  std::optional<WideType> wide{};
  bool is_big_endian = false;
  bool is_fortran = false;            // the first index is the fastest
  std::vector<std::int64_t> shape{};  // at most 32 numbers
  std::int64_t samples_start = 0;     // bytes in front of the samples

  [[nodiscard]] std::size_t sample_bytes() const { return volume::SizeOf(type); }
  // -1: more than any file has.
  [[nodiscard]] std::int64_t SampleCount() const;
};

// Returns true if a file, decoded, begins as an array.
bool IsNpyHeader(absl::string_view head);

// Parses the first bytes of an array, kNpyHeadBytes or all. `name` is for messages.
// INVALID_ARGUMENT: no such header, or cut; a version beyond 3; keys that are missing, twice or not
// known; a type that no volume has: objects (a pickle), records, complex numbers, texts, dates.
absl::StatusOr<NpyHeader> ParseNpyHeader(absl::string_view head, const std::string& name);

// The grid of an array[z, y, x], whose samples are 1 apart. The stored axes stay: in Fortran order
// the first one is the fastest, and its direction is that of world z. Of more than three axes those
// of length 1 at either end are left out. INVALID_ARGUMENT: not three axes then, or
// volume::Validate.
absl::StatusOr<volume::GridGeometry> NpyGrid(const NpyHeader& header, const std::string& name);

// Several volumes of one array, which follow each other or lie side by side.
struct NpyVolumes {
  volume::GridGeometry geometry{};
  std::int64_t count = 1;
  bool are_steps = false;    // of time; else components
  bool are_fastest = false;  // the samples of all at one place lie together
};
// The same by the letters of its axes (ParseAxisOrder): besides Z, Y and X one of T (steps) and C
// (components), in front of them or behind. INVALID_ARGUMENT: letters that do not fit, which names
// the shape; T or C between the others, or both; volume::Validate.
absl::StatusOr<NpyVolumes> NpyVolumesOf(const NpyHeader& header, const std::string& axes,
                                        const std::string& name);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_ARRAYS_NPY_HEADER_H_
