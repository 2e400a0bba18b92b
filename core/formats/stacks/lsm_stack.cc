// CZ_LSMINFO, little-endian; numbers of 4 bytes unless said otherwise:
//
//   0      magic number
//   8-24   samples along x, y and z; channels; steps of time
//   40-56  size of a voxel along x, y and z, in metres (8 bytes each)
//   88     kind of scan (2 bytes): 0 a stack, 3 planes in time, 6 stacks in time, others
//   112    seconds between steps (8 bytes)
//
// Source: the structures of https://github.com/cgohlke/tifffile, which follow Zeiss' description.

#include "core/formats/stacks/lsm_stack.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/source/bytes/binary_header.h"

namespace isoscope::source {

absl::StatusOr<StackLayout> ParseLsm(absl::string_view info) {
  constexpr std::size_t kNeeded = 120;
  constexpr std::array<std::uint32_t, 2> kMagics{0x00300494C, 0x00400494C};
  const BinaryHeader header(std::string(info), false);
  if (info.size() < kNeeded || (header.Load<std::uint32_t>(0) != kMagics[0] &&
                                header.Load<std::uint32_t>(0) != kMagics[1])) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "the tag of LSM has %d bytes, or an unknown mark; expected CZ_LSMINFO", info.size()));
  }
  StackLayout layout;
  layout.slices = header.Load<std::int32_t>(16);
  layout.channels = header.Load<std::int32_t>(20);
  layout.steps = header.Load<std::int32_t>(24);
  const bool has_counts = layout.slices >= 1 && layout.channels >= 1 && layout.steps >= 1 &&
                          layout.slices <= kMaxStackPlanes / layout.channels &&
                          layout.slices * layout.channels <= kMaxStackPlanes / layout.steps;
  if (!has_counts) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "LSM with %d slices, %d channels and %d steps; expected 1 or more of each, and at most %d "
        "planes",
        layout.slices, layout.channels, layout.steps, kMaxStackPlanes));
  }
  const auto scan = header.Load<std::uint16_t>(88);
  if (scan != 0 && scan != 3 && scan != 6) {
    return absl::InvalidArgumentError(
        absl::StrFormat("LSM with scan type %d; expected 0, 3 or 6: planes along x and y", scan));
  }
  std::vector<std::string> bad;
  for (int axis = 0; axis < 3; ++axis) {
    constexpr double kMicrometres = 1e6;
    const double size = header.Load<double>(40 + 8 * static_cast<std::size_t>(axis)) * kMicrometres;
    const bool is_good = std::isfinite(size) && size > 0;
    if (!is_good && (axis < 2 || layout.slices > 1)) {
      bad.push_back(absl::StrFormat("%g um along %c", size, "xyz"[axis]));
    }
    layout.spacing[axis] = is_good ? size : 1;
  }
  layout.length_unit = "um";
  if (!bad.empty()) {
    layout.distances = absl::StrCat("LSM with voxels of ", absl::StrJoin(bad, " and "));
  }
  const auto interval = header.Load<double>(112);
  for (std::int64_t i = 0;
       layout.steps > 1 && std::isfinite(interval) && interval > 0 && i < layout.steps; ++i) {
    layout.times.push_back(static_cast<double>(i) * interval);
  }
  layout.time_unit = layout.times.empty() ? "" : "s";
  LayPlanes("TZC", &layout);
  return layout;
}

}  // namespace isoscope::source
