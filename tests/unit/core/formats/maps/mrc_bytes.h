// MRC files of known words.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_FORMATS_MAPS_MRC_BYTES_H_
#define ISOSCOPE_TESTS_UNIT_CORE_FORMATS_MAPS_MRC_BYTES_H_

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string>

namespace isoscope::testing {

struct MrcWords {
  std::array<int, 3> dims{4, 3, 2};
  int mode = 2;
  std::array<float, 3> cell{8, 9, 10};
  std::array<float, 3> angles{90, 90, 90};
  std::array<int, 3> axes{1, 2, 3};
  std::array<float, 3> origin{10, 20, 30};
  std::array<int, 3> start{0, 0, 0};
  std::array<int, 3> grid{4, 3, 2};
  int space_group = 1;
  std::string extended{};
  std::optional<int> extended_bytes{};  // in place of its size
  std::optional<int> imod_flags{};
  std::optional<std::uint16_t> stamp{};  // in place of the right one
  bool is_big_endian = false;
};

// `samples` in the byte order of the file.
inline std::string MrcBytes(const MrcWords& words, const std::string& samples) {
  std::string bytes(1024, '\0');
  const auto put = [&](std::size_t word, auto value) {  // counted from 1
    char* const at = bytes.data() + 4 * (word - 1);
    std::memcpy(at, &value, 4);
    if (words.is_big_endian) {
      std::reverse(at, at + 4);
    }
  };
  for (std::size_t i = 0; i < 3; ++i) {
    put(1 + i, words.dims[i]);
    put(5 + i, words.start[i]);
    put(8 + i, words.grid[i]);
    put(11 + i, words.cell[i]);
    put(14 + i, words.angles[i]);
    put(17 + i, words.axes[i]);
    put(50 + i, words.origin[i]);
  }
  put(4, words.mode);
  put(23, words.space_group);
  put(24, words.extended_bytes.value_or(static_cast<int>(words.extended.size())));
  if (words.imod_flags.has_value()) {
    put(39, 1146047817);
    put(40, *words.imod_flags);
  }
  bytes.replace(208, 4, "MAP ");
  const std::uint16_t stamp = words.stamp.value_or(words.is_big_endian ? 0x1111 : 0x4144);
  std::memcpy(bytes.data() + 212, &stamp, sizeof(stamp));
  return bytes + words.extended + samples;
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_UNIT_CORE_FORMATS_MAPS_MRC_BYTES_H_
