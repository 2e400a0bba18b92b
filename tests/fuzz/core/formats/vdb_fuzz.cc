// OpenVDB, in the process of its library. Each input starts that process several times, and loading
// the library takes 100 ms.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "tests/fuzz/core/formats/open_volume.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/vdb_file.h"

namespace isoscope::fuzz {
namespace {

std::string File(const std::vector<testing::VdbFileGrid>& grids, bool is_stream = false) {
  testing::WriteVdbFile(InVolumeFolder("seed.vdb"), grids, is_stream);
  return ReadVolumeFile("seed.vdb");
}

}  // namespace

std::vector<std::string> Seeds() {
  const testing::VdbFileGrid density{
      .background = 1,
      .fills = {{.begin = {0, 0, 0}, .end = {8, 8, 8}, .value = 2},
                {.begin = {-3, 1, 2}, .end = {1, 4, 5}, .value = 7, .has_pattern = true}}};
  testing::VdbFileGrid velocity = density;
  velocity.name = "v";
  velocity.type = "vec3f";
  testing::VdbFileGrid half = density;
  half.type = "half";
  half.is_level_set = true;
  return {File({density}), File({density, velocity}), File({half}, true)};
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope::fuzz;
  WriteVolumeFile("v.vdb", Input(data, size).Rest());
  OpenAndReadSeries(InVolumeFolder("v.vdb"));
  return 0;
}
