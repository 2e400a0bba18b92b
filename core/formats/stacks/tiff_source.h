// TIFF stacks as sources: OME-TIFF, ImageJ's hyperstacks, LSM, and plain pages.

#ifndef ISOSCOPE_CORE_FORMATS_STACKS_TIFF_SOURCE_H_
#define ISOSCOPE_CORE_FORMATS_STACKS_TIFF_SOURCE_H_

#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/grid/grid_rules.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"

namespace isoscope::source {

// "slice9" before "slice10": runs of digits are compared as numbers.
bool NaturalLess(const std::string& a, const std::string& b);

// Opens one file of several pages, or several files of one page each in the order given. Planes are
// greyscale integers of 1 or 8 to 64 bits or floats of 16 to 64 bits; strips or tiles, any compression
// that libtiff knows, BigTIFF too. libtiff reads them page by page.
//
// OME-XML, ImageJ's description or LSM's tag say what the planes are: channels are fields, frames
// are steps, and sizes of pixels the spacing. Else all pages are slices, and the spacing is
// GeoTIFF's, else 1, because TIFF has only that of a print. Pages lie as TIFF's orientation says.
// `axes` says it in their place, as in stack_layout.h; "": as the file says. `name` is for
// messages, `field` the name of an only field. INVALID_ARGUMENT: no TIFF files; pages of different
// size or type (names the first); colour, palette, bits that are no whole bytes; planes that nobody
// names; a file outside the folder; sizes of pixels along some axes only, or pixels of a print that
// are not square, unless the rules have distances. NOT_FOUND: a file of an OME set. DATA_LOSS:
// damaged; fewer planes than the head says.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenTiffSeries(const std::vector<std::string>& files,
                                                             const std::string& name,
                                                             const std::string& field,
                                                             const std::string& axes,
                                                             const GridRules& rules = {});

// The file, and the others of its OME set; the file alone if it can't be opened.
absl::StatusOr<std::vector<std::string>> FilesOfTiff(const std::string& file);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_STACKS_TIFF_SOURCE_H_
