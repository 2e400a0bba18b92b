// Reads the XML of a VTK ImageData file: its grid, its arrays, and where their bytes begin.

#ifndef ISOSCOPE_CORE_SOURCE_VTI_HEADER_H_
#define ISOSCOPE_CORE_SOURCE_VTI_HEADER_H_

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/io/file.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

struct VtiArray {
  std::string name;
  std::string type;  // VTK's name: "Int16"
  std::int64_t components = 1;
  bool is_of_cells = false;
  std::string format{};            // "appended", "binary" or "ascii"
  std::string offset{};            // in the appended data
  std::int64_t inline_start = -1;  // in the file, behind the tag
  // Known after ReadWholeVtiHeader:
  std::vector<std::string> component_names{};  // one each, or none
  std::string unit{};                          // UNITS_LABEL
  std::string text{};                          // of TimeValue, if its format is "ascii"
};

struct VtiHeader {
  using Attributes = std::map<std::string, std::string>;

  bool is_image = false;
  bool is_big_endian = false;
  bool has_long_sizes = false;  // those before the samples have 64 bits
  std::string compressor;       // "" if none
  Attributes image;             // of the tag ImageData
  int piece_count = 0;
  std::string piece_extent;          // of the first piece
  std::vector<VtiArray> arrays;      // of the first piece; none behind the one that was looked for
  std::string point_scalars;         // the array that PointData calls its scalars
  std::string cell_scalars;          // and CellData
  std::string appended_encoding;     // "raw" or "base64"
  std::int64_t appended_start = -1;  // in the file, behind the tag AppendedData
  std::optional<VtiArray> time_value{};  // of FieldData; known after ReadWholeVtiHeader
};

// An array and one of its components.
struct VtiChoice {
  VtiArray array;
  std::int64_t component = 0;
};

// Reads the XML up to the samples, or, if arrays stand within it as text, up to that which `part`
// will choose. INVALID_ARGUMENT: no XML, or cut; a tag of more than a MiB; more than 4096 arrays.
absl::StatusOr<VtiHeader> ReadVtiHeader(const io::RandomAccessFile& file, const std::string& part);

// Reads the XML past all arrays, if they stand within it as text to the end of the file. Errors as
// ReadVtiHeader.
absl::StatusOr<VtiHeader> ReadWholeVtiHeader(const io::RandomAccessFile& file);

// The array that `part` names ("velocity", or "velocity:2" for one of its components, counted from
// 0), points before cells. Without a part: the first array of one component, points before cells,
// and of either that which the file calls its scalars. `path` is for messages. NOT_FOUND: no such
// array. INVALID_ARGUMENT: no array; several components and none chosen; no such component. All
// three list the arrays and the argument to give.
absl::StatusOr<VtiChoice> ChooseVtiArray(const VtiHeader& header, const std::string& part,
                                         const std::string& path);

// INVALID_ARGUMENT: no type that a volume can have.
absl::StatusOr<volume::ScalarType> VtiTypeOf(const VtiArray& array, const std::string& path);
// True if a volume can have the type, or it is Int64 or UInt64 (wide_source.h).
bool IsVtiNumber(const std::string& type);

// First and last point on x, y and z, both inclusive.
using VtiExtent = std::array<std::int64_t, 6>;

// "0 63 0 63 0 92". INVALID_ARGUMENT: no six numbers of 32 bits. `attribute` is for messages.
absl::StatusOr<VtiExtent> ParseVtiExtent(const std::string& text, const char* attribute,
                                         const std::string& path);

// The grid of the points of an extent, or of its cells' centres, by Origin, Spacing and Direction
// of the tag ImageData. It need not be a volume: it may have one sample on an axis, or none.
// INVALID_ARGUMENT: numbers that are none.
absl::StatusOr<volume::GridGeometry> VtiGridOf(const VtiHeader::Attributes& image,
                                               const VtiExtent& extent, bool is_of_cells,
                                               const std::string& path);

// The grid of the points, or of the cells' centres: one less on each axis, half a spacing further.
// INVALID_ARGUMENT: several pieces; numbers that are none; a grid that is no volume.
absl::StatusOr<volume::GridGeometry> VtiGeometry(const VtiHeader& header, bool is_of_cells,
                                                 const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_VTI_HEADER_H_
