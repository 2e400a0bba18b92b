// A codestream of High-Throughput JPEG 2000.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_FORMATS_DICOM_HTJ2K_BYTES_H_
#define ISOSCOPE_TESTS_UNIT_CORE_FORMATS_DICOM_HTJ2K_BYTES_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/escaping.h"

namespace isoscope::testing {

// 8 x 8 samples of 12 bits without a sign, without loss: sample i is 257 i modulo 4096. Debian's
// ojph_compress 0.9 made it.
inline std::string Htj2kBytes() {
  return absl::HexStringToBytes(
      "ff4fff51002940000000000800000008000000000000000000000008000000080000000000000000"
      "00010b0101ff500008000200000007ff52000c00020001000104044001ff5c00072070707078ff64"
      "001600014f70656e4a50482056657220302e392e302eff90000a0000000000600001ff93c0016e80"
      "ff7ffdfedb1b608222aafcbef9ee971ba18632eefc00670718c0599800c001550005d00000000000"
      "f0aa72027500fef77fff777fff7bbfff7ddfff1d80ff3b00ff7700feef000140c7210031b800ffd9");
}

inline std::vector<std::uint16_t> Htj2kSamples() {
  std::vector<std::uint16_t> samples;
  for (int i = 0; i < 64; ++i) {
    samples.push_back(static_cast<std::uint16_t>(257 * i % 4096));
  }
  return samples;
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_UNIT_CORE_FORMATS_DICOM_HTJ2K_BYTES_H_
