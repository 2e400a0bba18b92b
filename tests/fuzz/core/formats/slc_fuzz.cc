// SLC files, plain and in runs.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"

#include "tests/fuzz/core/formats/open_volume.h"
#include "tests/fuzz/fuzz_input.h"

namespace isoscope::fuzz {

std::vector<std::string> Seeds() {
  constexpr absl::string_view kHead = "11111\n4 3 2 8\n0.5 2 4\n1 0 0 ";
  const std::string slice = absl::StrCat("6 X", std::string("\x06"
                                                            "a\x86"
                                                            "bcdefg\0",
                                                            10));
  const std::string runs = absl::StrCat("10 X", std::string("\x06"
                                                            "a\x86"
                                                            "bcdefg\0",
                                                            10));
  return {absl::StrCat(kHead, "0\n1 1 Xico", std::string(24, 'v')),
          absl::StrCat(kHead, "1\n1 1 Xico", runs, runs),
          absl::StrCat(kHead, "1\n0 0 X", slice, runs)};
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope::fuzz;
  WriteVolumeFile("v.slc", Input(data, size).Rest());
  OpenAndReadSeries(InVolumeFolder("v.slc"));
  return 0;
}
