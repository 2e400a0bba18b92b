// Labels in headers of NRRD, AFNI and NIfTI. The first byte chooses.

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/formats/source_labels.h"
#include "tests/fuzz/core/formats/open_volume.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/volume_files.h"

namespace isoscope::fuzz {
namespace {

constexpr std::array<const char*, 3> kNames{{"v.nrrd", "v+orig.HEAD", "v.nii"}};

// A header of NIfTI-1 and one extension of 128 bytes.
std::string Nifti(const std::string& xml) {
  std::string bytes =
      testing::NiftiHeaderBytes({.dims = {2, 2, 2}, .datatype = 2, .vox_offset = 352 + 136});
  bytes[348] = 1;
  bytes += std::string("\x88\0\0\0\x1e\0\0\0", 8) + xml;
  bytes.resize(352 + 136 + 8, '\0');
  return bytes;
}

}  // namespace

std::vector<std::string> Seeds() {
  return {std::string(1, '\0') + testing::NrrdHeader({2, 2, 2}, "uint8", "raw",
                                                     "Segment0_LabelValue:=1\nSegment0_Name:=a\n"
                                                     "Segment0_Color:=0.5 1 0\n"),
          "\1type = string-attribute\nname = VALUE_LABEL_DTABLE\ncount = 99\n"
          "'<VALUE_LABEL_DTABLE ni_dimen=\"1\" > \"1\" \"a&lt;\" </VALUE_LABEL_DTABLE>~\n",
          "\2" + Nifti("<a><LabelTable><Label Key=\"1\" Red=\"1\">b</Label></LabelTable></a>"),
          "\2" + Nifti("<AFNI_atr atr_name=\"VALUE_LABEL_DTABLE\">&lt;VALUE_LABEL_DTABLE&gt;'1''a'"
                       "&lt;/VALUE_LABEL_DTABLE&gt;</AFNI_atr>")};
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope;
  fuzz::Input input(data, size);
  const std::string name = fuzz::kNames[input.Byte() % fuzz::kNames.size()];
  fuzz::WriteVolumeFile(name, input.Rest());
  const auto labels = source::ReadSourceLabels(fuzz::InVolumeFolder(name));
  if (!labels.ok()) {
    fuzz::RequireError(labels.status(), {absl::StatusCode::kInvalidArgument}, name);
    return 0;
  }
  fuzz::Require(volume::ValidateLabels(*labels).ok(), "accepted labels are valid");
  return 0;
}
