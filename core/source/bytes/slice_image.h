// One image of a stack.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_SLICE_IMAGE_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_SLICE_IMAGE_H_

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

#include "core/volume/scalar_type.h"

namespace isoscope::source {

// The limit along each axis, so that bytes can be counted.
inline constexpr std::int64_t kMaxSliceSamples = 65536;

struct SliceImage {
  std::int64_t width = 0;  // samples
  std::int64_t height = 0;
  volume::ScalarType type = volume::ScalarType::kUint8;
  std::int64_t bits = 0;  // of a sample, as the encoding says; 0: it says no more than the type
  std::string samples{};  // [y][x], little-endian; none if only the header was read
};

enum class SlicePart { kHeader, kAll };

inline absl::Status ColourSliceError(const std::string& path) {
  return absl::InvalidArgumentError(
      absl::StrCat(path,
                   ": a colour image; expected grey samples: convert it (ImageMagick: convert IN "
                   "-colorspace gray OUT)"));
}

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_SLICE_IMAGE_H_
