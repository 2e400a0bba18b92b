// MRC: the words of the header in both byte orders, axes, cells, stacks, compression by gzip.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "tests/fuzz/core/formats/open_volume.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/maps/mrc_bytes.h"

namespace isoscope::fuzz {

std::vector<std::string> Seeds() {
  using testing::MrcBytes;
  const std::string samples(96, 'a');
  return {MrcBytes({}, samples),
          MrcBytes({.mode = 0, .axes = {3, 1, 2}, .extended = "more"}, samples),
          MrcBytes({.mode = 12, .angles = {80, 90, 120}, .is_big_endian = true}, samples),
          MrcBytes({.dims = {4, 3, 4}, .mode = 1, .space_group = 401}, samples),
          testing::Gzip(MrcBytes({.mode = 6}, samples))};
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope::fuzz;
  WriteVolumeFile("v.mrc", Input(data, size).Rest());
  OpenAndReadSeries(InVolumeFolder("v.mrc"));
  return 0;
}
