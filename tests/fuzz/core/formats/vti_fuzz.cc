// VTK ImageData and RectilinearGrid: XML with its arrays appended or within it, plain, in base64,
// in zlib's blocks.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"

#include "core/base/coding.h"
#include "tests/fuzz/core/formats/open_volume.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/volume_files.h"

namespace isoscope::fuzz {
namespace {

std::string Lengths(const std::vector<std::uint32_t>& values) {
  std::string bytes;
  for (const std::uint32_t value : values) {
    base::AppendLittleEndian(value, &bytes);
  }
  return bytes;
}

std::string Text(int count) {
  std::string text;
  for (int i = 0; i < count; ++i) {
    absl::StrAppend(&text, i, " ");
  }
  return text;
}

std::string File(absl::string_view attributes, absl::string_view array, absl::string_view content,
                 absl::string_view appended) {
  return absl::StrCat(
      "<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" version=\"1.0\" "
      "byte_order=\"LittleEndian\"",
      attributes,
      ">\n<ImageData WholeExtent=\"0 4 0 3 0 2\" Origin=\"1 2 3\" Spacing=\"1 1 2\" "
      "Direction=\"1 0 0 0 1 0 0 0 1\">\n<Piece Extent=\"0 4 0 3 0 2\">\n"
      "<PointData Scalars=\"a\"><DataArray type=\"UInt8\" Name=\"a\" ",
      array, ">", content, "</DataArray></PointData><CellData/></Piece></ImageData>\n", appended,
      "</VTKFile>\n");
}

}  // namespace

std::vector<std::string> Seeds() {
  const std::string samples(60, 'a');
  const std::string plain = Lengths({60}) + samples;
  const std::string block = testing::Deflate(samples, 15);
  const std::string lengths = Lengths({1, 60, 0, static_cast<std::uint32_t>(block.size())});
  constexpr absl::string_view kAppended = "format=\"appended\" offset=\"0\"";
  constexpr absl::string_view kZlib = " compressor=\"vtkZLibDataCompressor\"";
  const std::string coordinates =
      "<Coordinates><DataArray type=\"Float32\" format=\"ascii\">0 1 2 3 4</DataArray>"
      "<DataArray type=\"Float64\" format=\"ascii\">0 1 2 3</DataArray>"
      "<DataArray type=\"Int16\" format=\"ascii\">0 1 2</DataArray></Coordinates></Piece>";
  const std::string text =
      absl::StrReplaceAll(File("", "format=\"ascii\"", Text(60), ""),
                          {{"ImageData", "RectilinearGrid"}, {"</Piece>", coordinates}});
  return {
      text,
      File("", kAppended, "",
           absl::StrCat("<AppendedData encoding=\"raw\">_", plain, "</AppendedData>")),
      File("", kAppended, "",
           absl::StrCat("<AppendedData encoding=\"base64\">_", absl::Base64Escape(plain),
                        "</AppendedData>")),
      File(kZlib, kAppended, "",
           absl::StrCat("<AppendedData encoding=\"raw\">_", lengths, block, "</AppendedData>")),
      File(kZlib, "format=\"binary\"",
           absl::StrCat(absl::Base64Escape(lengths), absl::Base64Escape(block)), ""),
      File(" header_type=\"UInt32\"", "format=\"binary\" NumberOfComponents=\"1\"",
           absl::Base64Escape(plain), ""),
      File("", "format=\"ascii\"", "1 2 3 4", ""),
  };
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope::fuzz;
  const auto bytes = Input(data, size).Rest();
  if (absl::StrContains(bytes, "RectilinearGrid")) {
    WriteVolumeFile("v.vtr", bytes);
    OpenAndReadSeries(InVolumeFolder("v.vtr"));
    return 0;
  }
  WriteVolumeFile("v.vti", bytes);
  OpenAndReadVolume(InVolumeFolder("v.vti"));
  OpenAndReadVolume(InVolumeFolder("v.vti:a:0"));
  return 0;
}
