// Legacy VTK files of structured points, as bytes and as text.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"

#include "tests/fuzz/core/formats/open_volume.h"
#include "tests/fuzz/fuzz_input.h"

namespace isoscope::fuzz {
namespace {

std::string File(absl::string_view coding, absl::string_view arrays) {
  return absl::StrCat("# vtk DataFile Version 5.1\ntitle\n", coding,
                      "\nDATASET STRUCTURED_POINTS\nDIMENSIONS 3 2 2\nORIGIN 1 2 3\n"
                      "SPACING 1 1 2\n",
                      arrays);
}

}  // namespace

std::vector<std::string> Seeds() {
  constexpr absl::string_view kNumbers = "1 2 3 4 5 6 7 8 9 10 11 12\n";
  return {
      File("ASCII", absl::StrCat("POINT_DATA 12\nSCALARS p float 1\nLOOKUP_TABLE default\n",
                                 kNumbers, "METADATA\nCOMPONENT_NAMES\na\n\n")),
      File("ASCII", absl::StrCat("FIELD FieldData 1\nTIME 1 1 double\n4.5\nPOINT_DATA 12\n"
                                 "VECTORS v int\n",
                                 kNumbers, kNumbers, kNumbers)),
      File("BINARY", absl::StrCat("POINT_DATA 12\nSCALARS p short\nLOOKUP_TABLE default\n",
                                  std::string(24, 'a'), "\nFIELD f 2\nq 1 12 unsigned_char\n",
                                  std::string(12, 'b'), "\ns 1 2 string\n\xc1t\xc1u\n")),
      File("BINARY", absl::StrCat("CELL_DATA 2\nSCALARS c long\nLOOKUP_TABLE default\n",
                                  std::string(16, '\0'), "\nLOOKUP_TABLE t 1\nabcd\n")),
      "# vtk DataFile Version 3.0\ntitle\nASCII\nDATASET POLYDATA\n",
  };
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope::fuzz;
  WriteVolumeFile("v.vtk", Input(data, size).Rest());
  OpenAndReadSeries(InVolumeFolder("v.vtk"));
  return 0;
}
