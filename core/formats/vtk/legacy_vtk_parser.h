// Parses a legacy VTK file: its grid, its arrays, and where their samples begin.

#ifndef ISOSCOPE_CORE_FORMATS_VTK_LEGACY_VTK_PARSER_H_
#define ISOSCOPE_CORE_FORMATS_VTK_LEGACY_VTK_PARSER_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/formats/vtk/legacy_vtk_grid.h"
#include "core/io/file.h"
#include "core/source/adapt/wide_source.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

// True if a file begins so.
bool IsLegacyVtk(absl::string_view head);

// An array of numbers of points or cells.
struct LegacyVtkArray {
  std::string name;
  volume::ScalarType type = volume::ScalarType::kUint8;
  std::optional<WideType> wide{};  // of 64-bit integers, whose type is their carrier
  std::int64_t components = 1;
  std::int64_t tuples = 0;  // one a sample
  bool is_of_cells = false;
  std::int64_t offset = 0;                     // in the file
  std::vector<std::string> component_names{};  // as the file has them, or none
  std::string unit{};                          // UNITS_LABEL
};

struct LegacyVtkFile {
  bool is_binary = false;
  LegacyGrid grid{};
  std::optional<double> time{};          // TIME or TimeValue of the field data
  std::vector<LegacyVtkArray> arrays{};  // in the order of the file; names may repeat
};

// Walks through the whole file; arrays of text or bits, colours and tables of colours are passed
// over. INVALID_ARGUMENT, with a message that is to follow the file's name and a colon: no such
// file; another kind of dataset (names it, and says what to do); sizes that do not fit; an array
// that ends early.
absl::StatusOr<LegacyVtkFile> ParseLegacyVtk(const io::RandomAccessFile& file);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_VTK_LEGACY_VTK_PARSER_H_
