// NRRD: one file, and a header with its samples in other files. The first byte chooses.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "tests/fuzz/core/formats/open_volume.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/volume_files.h"

namespace isoscope::fuzz {

std::vector<std::string> Seeds() {
  using testing::NrrdHeader;
  std::vector<std::string> seeds;
  const math::Index3 dims{5, 4, 3};
  const std::string samples(480, 'a');
  for (const char* type : {"uint8", "short", "unsigned int", "float", "double", "block"}) {
    seeds.push_back(std::string(1, '\0') + NrrdHeader(dims, type, "raw") + samples);
  }
  seeds.push_back(std::string(1, '\0') + NrrdHeader(dims, "int16", "raw", "", "big") + samples);
  const std::string packed = testing::Gzip(samples.substr(0, 60));
  seeds.push_back(std::string(1, '\0') + NrrdHeader(dims, "uint8", "gzip") + packed);
  seeds.push_back(std::string(1, '\0') +
                  NrrdHeader(dims, "uint8", "gzip", "byte skip: 3\nline skip: 0\n") + packed);
  seeds.push_back(std::string(1, '\0') + NrrdHeader(dims, "uint8", "raw", "byte skip: -1\n") +
                  samples);
  std::string numbers;
  for (int i = 0; i < 60; ++i) {
    numbers += std::to_string(i - 7) + (i % 5 == 4 ? "\n" : " ");
  }
  seeds.push_back(std::string(1, '\0') + NrrdHeader(dims, "short", "ascii") + numbers);
  seeds.push_back(std::string(1, '\0') + NrrdHeader(dims, "uint8", "hex") + std::string(120, '7'));
  // bzip2 of "hello".
  const std::string bzip2(
      "BZh91AY&SY\x19\x31\x65\x3d\x00\x00\x00\x81\x00\x02\x44\xa0\x00\x21\x9a\x68\x33\x4d\x07\x33"
      "\x8b\xb9\x22\x9c\x28\x48\x0c\x98\xb2\x9e\x80",
      41);
  seeds.push_back(std::string(1, '\0') + NrrdHeader(dims, "uint8", "bzip2") + bzip2);
  seeds.push_back("\1" + NrrdHeader(dims, "uint8", "raw", "data file: a0.raw\n"));
  seeds.push_back("\1" + NrrdHeader(dims, "uint8", "raw", "data file: a%d.raw 0 2 1 2\n"));
  seeds.push_back("\1" +
                  NrrdHeader(dims, "uint8", "raw", "data file: LIST 2\na0.raw\na1.raw\na2.raw\n"));
  return seeds;
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope::fuzz;
  Input input(data, size);
  const bool is_detached = input.Byte() % 2 == 1;
  const std::string name = is_detached ? "v.nhdr" : "v.nrrd";
  if (is_detached) {
    for (const char* part : {"a0.raw", "a1.raw", "a2.raw"}) {
      WriteVolumeFile(part, std::string(60, 'c'));
    }
  }
  WriteVolumeFile(name, input.Rest());
  OpenAndReadVolume(InVolumeFolder(name));
  return 0;
}
