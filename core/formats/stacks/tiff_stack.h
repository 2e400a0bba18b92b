// Which plane of which TIFF file holds which slice, channel and step.

#ifndef ISOSCOPE_CORE_FORMATS_STACKS_TIFF_STACK_H_
#define ISOSCOPE_CORE_FORMATS_STACKS_TIFF_STACK_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/formats/stacks/tiff_file.h"
#include "core/source/grid/stack_layout.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::source {

// All that the volumes of a stack share.
struct TiffStack {
  std::string name;
  std::vector<std::string> files;  // by StackPlane::file
  std::string companion{};         // the file with the OME-XML, if that is not in files[0]
  TiffPages pages{};               // of files[scanned_file]
  std::int32_t scanned_file = 0;   // below 0: none
  PageFormat format{};
  TiffColours colours = TiffColours::kRefused;
  // Set if the planes of the only file lie raw behind each other: the first byte of the first.
  std::optional<std::int64_t> raw_offset{};
  bool is_big_endian = false;
  StackLayout layout{};
};

// Finds the planes of one file of several pages, or of several files of one page each in the order
// given. `name` is for messages, `axes` as in OpenTiffSeries, whose errors these are.
absl::StatusOr<TiffStack> FindTiffStack(const std::vector<std::string>& files,
                                        const std::string& name, const std::string& axes);

// Turns the grid of stored pages as TIFF's tag of orientation says. Row 0 may be at the bottom,
// column 0 may be at the right, or rows may be columns. It fills the same box from the origin
// on. REQUIRES: 1 to 8.
void TurnPages(std::uint16_t orientation, volume::GridGeometry* geometry);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_STACKS_TIFF_STACK_H_
