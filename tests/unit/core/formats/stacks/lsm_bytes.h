// The tag CZ_LSMINFO.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_FORMATS_STACKS_LSM_BYTES_H_
#define ISOSCOPE_TESTS_UNIT_CORE_FORMATS_STACKS_LSM_BYTES_H_

#include <cstdint>
#include <cstring>
#include <string>

namespace isoscope::testing {

struct LsmInfo {
  std::int32_t slices = 2;
  std::int32_t channels = 1;
  std::int32_t steps = 1;
  double voxel_metres[3] = {1e-7, 2e-7, 5e-7};
  std::uint16_t scan = 0;
  double interval = 0;
};

inline std::string LsmBytes(const LsmInfo& info) {
  std::string bytes(500, '\0');
  const auto put = [&](std::size_t at, auto value) {
    std::memcpy(bytes.data() + at, &value, sizeof(value));
  };
  put(0, std::uint32_t{0x00400494C});
  put(4, std::int32_t{500});
  put(8, std::int32_t{4});
  put(12, std::int32_t{3});
  put(16, info.slices);
  put(20, info.channels);
  put(24, info.steps);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    put(40 + 8 * axis, info.voxel_metres[axis]);
  }
  put(88, info.scan);
  put(112, info.interval);
  return bytes;
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_UNIT_CORE_FORMATS_STACKS_LSM_BYTES_H_
