// A stack of TIFF images as a source.

#ifndef ISOSCOPE_CORE_SOURCE_TIFF_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_TIFF_SOURCE_H_

#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/volume_source.h"

namespace isoscope::source {

// "slice9" before "slice10": runs of digits are compared as numbers.
bool NaturalLess(const std::string& a, const std::string& b);

// Opens one file of several pages, or several files of one page each in the order given, as slices
// of one volume. Greyscale integers of 8 to 32 bits or floats of 32 or 64 bits; strips or tiles,
// any compression that libtiff knows, BigTIFF too. By libtiff itself: ITK reads all pages at once.
// The spacing is 1, because TIFF has only that of a print. `name` is for messages.
// INVALID_ARGUMENT: no TIFF files; pages of different size or type (names the first); colour,
// palette, bits that are no whole bytes. DATA_LOSS: damaged.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenTiffStack(const std::vector<std::string>& files,
                                                            const std::string& name);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_TIFF_SOURCE_H_
