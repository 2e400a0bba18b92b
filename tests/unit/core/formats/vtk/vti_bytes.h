// VTK ImageData files of known values.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_FORMATS_VTK_VTI_BYTES_H_
#define ISOSCOPE_TESTS_UNIT_CORE_FORMATS_VTK_VTI_BYTES_H_

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"

#include "core/base/coding.h"

namespace isoscope::testing {

// Values as little-endian bytes.
template <typename T>
std::string BytesOf(const std::vector<T>& values) {
  std::string bytes(values.size() * sizeof(T), '\0');
  if (!values.empty()) {
    std::memcpy(bytes.data(), values.data(), bytes.size());
  }
  return bytes;
}

template <typename T>
std::vector<T> ValuesOf(const std::string& bytes) {
  std::vector<T> values(bytes.size() / sizeof(T));
  if (!values.empty()) {
    std::memcpy(values.data(), bytes.data(), values.size() * sizeof(T));
  }
  return values;
}

struct VtiField {
  std::string name;
  std::string type;
  std::string samples;  // little-endian
  int components = 1;
  bool is_of_cells = false;
  std::string more{};      // attributes
  std::string children{};  // tags
};

struct VtiImageFile {
  std::string extent;  // "0 3 0 2 0 1"
  std::vector<VtiField> fields;
  std::string field_data{};                                       // tags
  std::string image = "Origin=\"10 20 30\" Spacing=\"0.5 2 4\"";  // attributes
};

// Uncompressed, in raw appended data.
inline std::string VtiBytes(const VtiImageFile& file) {
  std::string tags[2];
  std::string data;
  for (const VtiField& field : file.fields) {
    absl::StrAppend(&tags[field.is_of_cells ? 1 : 0], "<DataArray type=\"", field.type,
                    "\" Name=\"", field.name, "\" NumberOfComponents=\"", field.components, "\" ",
                    field.more, " format=\"appended\" offset=\"", data.size(), "\">",
                    field.children, "</DataArray>\n");
    base::AppendLittleEndian(static_cast<std::uint64_t>(field.samples.size()), &data);
    data += field.samples;
  }
  return absl::StrCat(
      "<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\" "
      "header_type=\"UInt64\">\n<ImageData WholeExtent=\"",
      file.extent, "\" ", file.image, ">\n", file.field_data, "<Piece Extent=\"", file.extent,
      "\">\n<PointData>\n", tags[0], "</PointData>\n<CellData>\n", tags[1],
      "</CellData>\n</Piece>\n</ImageData>\n<AppendedData encoding=\"raw\">\n_", data,
      "\n</AppendedData>\n</VTKFile>\n");
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_UNIT_CORE_FORMATS_VTK_VTI_BYTES_H_
