// Grey images in JPEG and JPEG 2000.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_JPEG_SLICE_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_JPEG_SLICE_H_

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/bytes/slice_image.h"

namespace isoscope::source {

// Decodes a JPEG of 8 bits a sample by libjpeg-turbo. It is decoded whole for its header, too.
// INVALID_ARGUMENT: colours. DATA_LOSS: no JPEG, or one that is not complete.
absl::StatusOr<SliceImage> ReadJpegSlice(const std::string& path, SlicePart part);

// Memory of ReadJpeg2000Slice beside the file, for each sample: 32 bits in the image and in a tile
// each, and the samples.
inline constexpr std::int64_t kJpeg2000BytesPerSample = 12;

// Decodes a JPEG 2000 image, alone or in a file of boxes (JP2), of up to 16 bits a sample, by
// OpenJPEG. INVALID_ARGUMENT: colours, palettes, more bits. DATA_LOSS: no JPEG 2000, a tile is
// missing, or the file ends before.
absl::StatusOr<SliceImage> ReadJpeg2000Slice(const std::string& path, SlicePart part);
// The same of bytes, also of High-Throughput JPEG 2000 (ITU-T T.814). `name` is for messages.
absl::StatusOr<SliceImage> DecodeJpeg2000(absl::string_view bytes, const std::string& name,
                                          SlicePart part);

// True if the codestream in `bytes` has all parts of all tiles, and its end (EOC). Does not decode.
// O(tile-parts). OpenJPEG gives zeros for missing tiles.
// Source: ITU-T T.800, annexes A and I.
bool HasAllTiles(absl::string_view bytes);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_JPEG_SLICE_H_
