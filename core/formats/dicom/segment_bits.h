// Segments as bits of pixels: reading them, and which of them overlap.

#ifndef ISOSCOPE_CORE_FORMATS_DICOM_SEGMENT_BITS_H_
#define ISOSCOPE_CORE_FORMATS_DICOM_SEGMENT_BITS_H_

#include <cstddef>
#include <cstdint>
#include <vector>

#include "absl/status/status.h"

#include "core/io/file.h"

namespace isoscope::source {

// 64 pixels a word, the first one in the lowest bit; bits behind the last pixel are 0.
using SegmentWords = std::vector<std::uint64_t>;

// Reads `count` bits from the bit `first` on of the bytes at `offset`, whose lowest bit comes
// first. DATA_LOSS: the file ends before.
absl::Status ReadSegmentBits(const io::RandomAccessFile& file, std::int64_t offset,
                             std::int64_t first, std::int64_t count, SegmentWords* words);

// Thread-compatible.
class SegmentOverlaps {
 public:
  static constexpr std::size_t kMaxSegments = 4096;

  // REQUIRES: at most kMaxSegments.
  explicit SegmentOverlaps(std::size_t segments);

  // Tells of pixels that all these segments may have. REQUIRES: masks of one size; each segment
  // once.
  struct Mask {
    std::size_t segment = 0;
    SegmentWords words{};
  };
  void Add(const std::vector<Mask>& masks);

  // The layer of each segment, from 0 on: the first one in which it overlaps no segment before it.
  [[nodiscard]] std::vector<std::size_t> Layers() const;

 private:
  [[nodiscard]] bool Overlaps(std::size_t a, std::size_t b) const {
    return pairs_[a * segments_ + b];
  }

  const std::size_t segments_;
  std::vector<bool> pairs_;  // [a][b], a > b
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_DICOM_SEGMENT_BITS_H_
