// Gaussian cube files.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "tests/fuzz/core/formats/open_volume.h"
#include "tests/fuzz/fuzz_input.h"

namespace isoscope::fuzz {

std::vector<std::string> Seeds() {
  return {
      "a\nb\n 1 1.0 2.0 3.0\n 2 0.5 0 0\n 2 0 2 0\n 2 0 0 4\n 8 8.0 0 0 0\n 1 2 3 4\n 5 6 7 8e-3\n",
      "a\nb\n -1 1.0 2.0 3.0 1\n -2 0.5 0 0\n -2 0 2 0\n -2 0 0 4\n 8 8.0 0 0 0\n 2 5 6\n"
      " 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 1.6D+01\n",
  };
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope::fuzz;
  WriteVolumeFile("v.cube", Input(data, size).Rest());
  OpenAndReadSeries(InVolumeFolder("v.cube"));
  return 0;
}
