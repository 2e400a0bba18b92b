// Texts of VTK ImageData files, tag by tag, and how tests read them.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_FORMATS_VTK_VTI_TAGS_H_
#define ISOSCOPE_TESTS_UNIT_CORE_FORMATS_VTK_VTI_TAGS_H_

#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/formats/vtk/vti_choice.h"
#include "core/formats/vtk/vti_header.h"
#include "core/io/file.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::testing {

// A tag DataArray: of appended data, or with `text` in it.
inline std::string VtiArrayTag(const std::string& name, const std::string& type = "Float32",
                               const std::string& more = "", const std::string& text = "") {
  return absl::StrCat("<DataArray Name=\"", name, "\" type=\"", type, "\" ",
                      text.empty() ? "format=\"appended\" offset=\"0\" " : "format=\"binary\" ",
                      more, ">", text, "</DataArray>\n");
}
// An attribute of VtiArrayTag.
inline constexpr char kThreeComponents[] = "NumberOfComponents=\"3\"";

// A file of 4 x 5 x 3 points, turned about z, with those arrays of points and of cells. Its
// appended data is no XML.
inline std::string VtiTags(const std::string& points, const std::string& cells = "",
                           const std::string& point_attributes = "",
                           const std::string& cell_attributes = "") {
  return absl::StrCat(
      "<VTKFile type=\"ImageData\" byte_order=\"BigEndian\" header_type=\"UInt64\">\n"
      "<ImageData WholeExtent=\"2 5 -1 3 0 2\" Origin=\"10 20 30\" Spacing=\"0.5 2 4\" "
      "Direction=\"0 -1 0 1 0 0 0 0 1\">\n<Piece Extent=\"2 5 -1 3 0 2\">\n<PointData ",
      point_attributes, ">", points, "</PointData>\n<CellData ", cell_attributes, ">", cells,
      "</CellData></Piece></ImageData>\n<AppendedData encoding=\"raw\">\n_\1\2<&");
}

// Reads headers from texts.
class VtiTagsTest : public ::testing::Test {
 protected:
  absl::StatusOr<source::VtiHeader> Read(const std::string& bytes) {
    WriteFile(dir_.Sub("v.vti"), bytes);
    const auto file = io::OpenRandomAccessFile(dir_.Sub("v.vti"));
    return file.ok() ? source::ReadWholeVtiHeader(**file) : file.status();
  }
  absl::StatusOr<source::VtiChoice> Choose(const std::string& bytes, const std::string& part = "") {
    const auto header = Read(bytes);
    return header.ok() ? source::ChooseVtiArray(*header, part, "v.vti") : header.status();
  }
  // "p:name:component" or "c:name:component".
  std::string Chosen(const std::string& bytes, const std::string& part = "") {
    const auto choice = Choose(bytes, part);
    return choice.ok() ? absl::StrCat(choice->array.is_of_cells ? "c:" : "p:", choice->array.name,
                                      ":", choice->component)
                       : choice.status().ToString();
  }
  TempDir dir_;
};

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_UNIT_CORE_FORMATS_VTK_VTI_TAGS_H_
