// MetaImage: one file, and a header with its samples in other files. The first byte chooses.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "tests/fuzz/core/formats/open_volume.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/volume_files.h"

namespace isoscope::fuzz {

std::vector<std::string> Seeds() {
  using testing::MetaHeader;
  std::vector<std::string> seeds;
  const math::Index3 dims{5, 4, 3};
  const std::string samples(480, 'a');
  for (const char* type : {"MET_UCHAR", "MET_SHORT", "MET_UINT", "MET_FLOAT", "MET_DOUBLE"}) {
    seeds.push_back(std::string(1, '\0') + MetaHeader(dims, type, "LOCAL") + samples);
  }
  const std::string packed = testing::Deflate(samples.substr(0, 60), 15);
  seeds.push_back(std::string(1, '\0') +
                  MetaHeader(dims, "MET_UCHAR", "LOCAL", "CompressedData = True\n") + packed);
  seeds.push_back(
      std::string(1, '\0') +
      MetaHeader(dims, "MET_USHORT", "LOCAL", "BinaryDataByteOrderMSB = True\nHeaderSize = -1\n") +
      samples);
  seeds.push_back(std::string(1, '\0') +
                  MetaHeader(dims, "MET_SHORT", "LOCAL", "BinaryData = False\n") +
                  std::string(240, '7'));
  seeds.push_back("\1" + MetaHeader(dims, "MET_UCHAR", "a0.raw"));
  seeds.push_back("\1" + MetaHeader(dims, "MET_UCHAR", "a%d.raw 0 2 1"));
  seeds.push_back("\1" + MetaHeader(dims, "MET_UCHAR", "LIST 2D\na0.raw\na1.raw\na2.raw"));
  return seeds;
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope::fuzz;
  Input input(data, size);
  const bool is_detached = input.Byte() % 2 == 1;
  const std::string name = is_detached ? "v.mhd" : "v.mha";
  if (is_detached) {
    for (const char* part : {"a0.raw", "a1.raw", "a2.raw"}) {
      WriteVolumeFile(part, std::string(60, 'c'));
    }
  }
  WriteVolumeFile(name, input.Rest());
  OpenAndReadVolume(InVolumeFolder(name));
  return 0;
}
