// Reads the XML of a VTK ImageData file: its grid, its arrays, and where their bytes begin.

#ifndef ISOSCOPE_CORE_SOURCE_VTI_HEADER_H_
#define ISOSCOPE_CORE_SOURCE_VTI_HEADER_H_

#include <cstdint>
#include <map>
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
  std::string format;              // "appended", "binary" or "ascii"
  std::string offset;              // in the appended data
  std::int64_t inline_start = -1;  // in the file, behind the tag
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
  std::vector<VtiArray> arrays;      // of the first piece; none behind the one that `part` chooses
  std::string point_scalars;         // the array that PointData calls its scalars
  std::string cell_scalars;          // the same for CellData
  std::string appended_encoding;     // "raw" or "base64"
  std::int64_t appended_start = -1;  // in the file, behind the tag AppendedData
};

// An array and one of its components.
struct VtiChoice {
  VtiArray array;
  std::int64_t component = 0;
};

// Reads the XML up to the samples; with inline arrays, up to the array that `part` chooses.
// INVALID_ARGUMENT: no XML, or cut; a tag of more than a MiB; more than 4096 arrays.
absl::StatusOr<VtiHeader> ReadVtiHeader(const io::RandomAccessFile& file, const std::string& part);

// Returns the array that `part` names ("velocity", or "velocity:2" for one of its components,
// counted from 0), points before cells. Without a part: the first array of one component, points
// before cells, and among either the one that the file calls its scalars. `path` is for messages.
// NOT_FOUND: no such array. INVALID_ARGUMENT: no array; several components and none chosen; no such
// component. All three list the arrays and the argument to give.
absl::StatusOr<VtiChoice> ChooseVtiArray(const VtiHeader& header, const std::string& part,
                                         const std::string& path);

// INVALID_ARGUMENT: a type that no volume has.
absl::StatusOr<volume::ScalarType> VtiTypeOf(const VtiArray& array, const std::string& path);

// The grid of the points, or of the cells' centres: one less on each axis, half a spacing further.
// INVALID_ARGUMENT: several pieces; malformed numbers; a grid that is no volume.
absl::StatusOr<volume::GridGeometry> VtiGeometry(const VtiHeader& header, bool is_of_cells,
                                                 const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_VTI_HEADER_H_
