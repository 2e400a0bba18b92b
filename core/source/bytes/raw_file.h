// A file of samples without a header.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_RAW_FILE_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_RAW_FILE_H_

#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "core/source/volume_source.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

// The facts that a file without a header lacks. Its samples lie 1 world unit apart, the first at
// 0, 0, 0; placed_source.h (adapt) changes that.
struct RawFormat {
  math::Index3 dims;
  volume::ScalarType type = volume::ScalarType::kUint8;
  bool is_big_endian = false;
  std::int64_t header_bytes = 0;
};

// Opens a raw file. INVALID_ARGUMENT if it is smaller than the flags promise (names both sizes).
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenRawFile(const std::string& path,
                                                          const RawFormat& format);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_RAW_FILE_H_
