// A source made of slices that are decoded whole, one at a time.

#ifndef ISOSCOPE_CORE_SOURCE_ADAPT_SLICE_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_ADAPT_SLICE_SOURCE_H_

#include <cstdint>
#include <memory>

#include "absl/status/status.h"

#include "core/source/volume_source.h"

namespace isoscope::source {

// Thread-compatible.
class SliceReader {
 public:
  virtual ~SliceReader() = default;
  // Decodes slice `z` as [y][x], x fastest, little-endian, into `out`.
  virtual absl::Status ReadSlice(std::int64_t z, char* out) = 0;
  // Bytes of this process that the reader takes beside the slices.
  [[nodiscard]] virtual std::int64_t memory_bytes() const { return 0; }
};

// Makes a source from slices. Whole slices are decoded in place, parts through a copy of their
// slice. Holds two slices at most (one here, one in the library that decodes it). `info` says
// all but whether it is seekable, and its memory. REQUIRES: its geometry is valid.
std::unique_ptr<VolumeSource> MakeSliceSource(SourceInfo info, std::unique_ptr<SliceReader> reader);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_ADAPT_SLICE_SOURCE_H_
