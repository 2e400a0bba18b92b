// MRtrix images: layouts, transforms, types, and files beside a header.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "tests/fuzz/core/formats/open_volume.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/volume_files.h"

namespace isoscope::fuzz {

std::vector<std::string> Seeds() {
  const std::string samples(96, 'a');
  const std::string image =
      "mrtrix image\ndim: 4,3,2\nvox: 1,2,3\nlayout: +2,-0,+1\ndatatype: Float32LE\n"
      "transform: 1,0,0,-4\ntransform: 0,1,0,5\ntransform: 0,0,1,6\nfile: . 160\nEND\n";
  const std::string volumes =
      "mrtrix image\ndim: 2,3,2,2\nvox: 1,1,1,2\nlayout: +1,+2,+3,+0\ndatatype: uint8\n"
      "scaling: 1,2\nfile: v.dat 0\nEND\n";
  return {image + std::string(160 - image.size(), '\0') + samples, volumes,
          testing::Gzip(image + std::string(160 - image.size(), '\0') + samples)};
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope::fuzz;
  WriteVolumeFile("v.dat", std::string(24, 'b'));
  WriteVolumeFile("v.mif", Input(data, size).Rest());
  OpenAndReadSeries(InVolumeFolder("v.mif"));
  return 0;
}
