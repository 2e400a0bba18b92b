// Reads the XML of a VTK ImageData or RectilinearGrid file: its tags, its arrays, and where their
// bytes begin.

#ifndef ISOSCOPE_CORE_FORMATS_VTK_VTI_HEADER_H_
#define ISOSCOPE_CORE_FORMATS_VTK_VTI_HEADER_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/io/file.h"
#include "core/source/grid/vtk_extent.h"

namespace isoscope::source {

struct VtiArray {
  std::string name;
  std::string type;  // VTK's name: "Int16"
  std::int64_t components = 1;
  bool is_of_cells = false;
  std::string format{};                        // "appended", "binary" or "ascii"
  std::string offset{};                        // in the appended data
  std::int64_t inline_start = -1;              // in the file, behind the tag
  std::vector<std::string> component_names{};  // one each, or none
  std::string unit{};                          // UNITS_LABEL
  std::string text{};                          // of TimeValue, if its format is "ascii"
};

struct VtiHeader {
  using Attributes = VtkAttributes;

  bool is_image = false;
  bool is_rectilinear = false;
  bool is_big_endian = false;
  bool has_long_sizes = false;  // those before the samples have 64 bits
  std::string compressor;       // "" if none
  Attributes image;             // of the tag ImageData or RectilinearGrid
  int piece_count = 0;
  std::string piece_extent;      // of the first piece
  std::vector<VtiArray> arrays;  // of the first piece
  // The coordinates x, y and z of the first piece of a RectilinearGrid.
  std::vector<VtiArray> coordinates{};
  std::string point_scalars;             // the array that PointData calls its scalars
  std::string cell_scalars;              // the same for CellData
  std::string appended_encoding;         // "raw" or "base64"
  std::int64_t appended_start = -1;      // in the file, behind the tag AppendedData
  std::optional<VtiArray> time_value{};  // of FieldData
};

// Reads the XML past all arrays, if they stand within it as text to the end of the file.
// INVALID_ARGUMENT: no XML, or cut; a tag of more than a MiB; more than 4096 arrays.
absl::StatusOr<VtiHeader> ReadWholeVtiHeader(const io::RandomAccessFile& file);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_VTK_VTI_HEADER_H_
