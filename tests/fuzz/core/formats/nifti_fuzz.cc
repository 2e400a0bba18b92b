// NIfTI: one file, one that is compressed, a pair. The first byte chooses.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "tests/fuzz/core/formats/open_volume.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/volume_files.h"

namespace isoscope::fuzz {

std::vector<std::string> Seeds() {
  std::vector<std::string> seeds;
  const math::Index3 dims{5, 4, 3};
  for (const int datatype : {2, 4, 8, 16, 64, 256, 512, 768}) {
    for (const bool is_big_endian : {false, true}) {
      const std::string header =
          testing::NiftiHeaderBytes({.dims = dims,
                                     .datatype = static_cast<std::int16_t>(datatype),
                                     .is_big_endian = is_big_endian});
      seeds.push_back(std::string(1, '\0') + header + std::string(480, 'a'));
    }
  }
  const std::string scaled =
      testing::NiftiHeaderBytes({.dims = dims, .slope = 2, .intercept = -1}) +
      std::string(120, 'b');
  seeds.push_back("\1" + scaled);
  seeds.push_back("\2" + testing::Gzip(scaled));
  seeds.push_back("\3" + testing::NiftiHeaderBytes({.dims = dims, .is_pair = true}));
  return seeds;
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope::fuzz;
  Input input(data, size);
  const std::uint8_t kind = input.Byte() % 4;
  const absl::string_view bytes = input.Rest();
  if (kind == 0) {
    WriteVolumeFile("v.nii", bytes);
    OpenAndReadVolume(InVolumeFolder("v.nii"));
  } else if (kind == 1) {
    WriteVolumeFile("v.nii.gz", isoscope::testing::Gzip(std::string(bytes)));
    OpenAndReadVolume(InVolumeFolder("v.nii.gz"));
  } else if (kind == 2) {
    WriteVolumeFile("v.nii.gz", bytes);
    OpenAndReadVolume(InVolumeFolder("v.nii.gz"));
  } else {
    WriteVolumeFile("v.hdr", bytes);
    WriteVolumeFile("v.img", std::string(600, 'c'));
    OpenAndReadVolume(InVolumeFolder("v.hdr"));
  }
  return 0;
}
