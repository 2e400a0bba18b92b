// NumPy arrays and archives of them. The first byte chooses.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "tests/fuzz/core/formats/open_volume.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/unit/core/formats/arrays/npy_bytes.h"
#include "tests/unit/core/source/bytes/zip_bytes.h"

namespace isoscope::fuzz {

std::vector<std::string> Seeds() {
  using testing::NpyBytes;
  using testing::ZipBytes;
  const std::string array = NpyBytes("<f4", "(2, 3, 4)", std::string(96, 'a'));
  return {std::string(1, '\0') + array,
          std::string(1, '\0') + NpyBytes(">i8", "(1, 2, 3, 4)", std::string(192, '\0'), true, 3),
          "\1" + ZipBytes({{.name = "a.npy", .bytes = array},
                           {.name = "b.npy", .bytes = array, .is_deflated = true}}),
          "\1" + ZipBytes({{.name = "a.npy", .bytes = array}}, {.is_long = true, .comment = "x"})};
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope::fuzz;
  const std::string bytes(Input(data, size).Rest());
  const char* name = !bytes.empty() && bytes[0] % 2 != 0 ? "v.npz" : "v.npy";
  WriteVolumeFile(name, bytes.substr(bytes.empty() ? 0 : 1));
  OpenAndReadSeries(InVolumeFolder(name));
  return 0;
}
