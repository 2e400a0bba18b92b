// A slice in PNG.

#ifndef ISOSCOPE_CORE_FORMATS_STACKS_PNG_SLICE_H_
#define ISOSCOPE_CORE_FORMATS_STACKS_PNG_SLICE_H_

#include <string>

#include "absl/status/statusor.h"

#include "core/source/bytes/slice_image.h"

namespace isoscope::source {

// Reads a slice of 8 or 16 bits; fewer bits are scaled to 8, so that white is 255. Calls libpng:
// for the child. INVALID_ARGUMENT: no PNG; colours, a palette or opacity; more than
// kMaxSliceSamples along an axis. DATA_LOSS: the file is cut or damaged.
absl::StatusOr<SliceImage> ReadPngSlice(const std::string& path, SlicePart part);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_STACKS_PNG_SLICE_H_
