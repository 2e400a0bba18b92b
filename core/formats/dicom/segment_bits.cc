#include "core/formats/dicom/segment_bits.h"

#include <algorithm>

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/status_macros.h"

namespace isoscope::source {

absl::Status ReadSegmentBits(const io::RandomAccessFile& file, std::int64_t offset,
                             std::int64_t first, std::int64_t count, SegmentWords* words) {
  const auto word_count = static_cast<std::size_t>((count + 63) / 64);
  const auto shift = static_cast<unsigned>(first % 8);
  const auto byte_count = static_cast<std::size_t>((first % 8 + count + 7) / 8);
  // A shifted word takes bits of the byte behind it.
  std::vector<char> bytes(std::max(8 * word_count + 8, byte_count), 0);
  ISOSCOPE_RETURN_IF_ERROR(file.ReadAt(offset + first / 8, byte_count, bytes.data()));
  words->resize(word_count);
  for (std::size_t i = 0; i < word_count; ++i) {
    std::uint64_t word = base::LoadLittleEndian<std::uint64_t>(bytes.data() + 8 * i) >> shift;
    if (shift > 0) {
      word |= std::uint64_t{base::LoadLittleEndian<std::uint8_t>(bytes.data() + 8 * i + 8)}
              << (64 - shift);
    }
    (*words)[i] = word;
  }
  if (const auto rest = static_cast<unsigned>(count % 64); rest > 0) {
    words->back() &= (std::uint64_t{1} << rest) - 1;
  }
  return absl::OkStatus();
}

SegmentOverlaps::SegmentOverlaps(std::size_t segments)
    : segments_(segments), pairs_(segments * segments) {
  ISOSCOPE_CHECK(segments <= kMaxSegments);
}

void SegmentOverlaps::Add(const std::vector<Mask>& masks) {
  for (std::size_t i = 0; i < masks.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const std::size_t pair = std::max(masks[i].segment, masks[j].segment) * segments_ +
                               std::min(masks[i].segment, masks[j].segment);
      if (!pairs_[pair]) {
        pairs_[pair] =
            std::mismatch(masks[i].words.begin(), masks[i].words.end(), masks[j].words.begin(),
                          [](std::uint64_t a, std::uint64_t b) { return (a & b) == 0; })
                .first != masks[i].words.end();
      }
    }
  }
}

std::vector<std::size_t> SegmentOverlaps::Layers() const {
  std::vector<std::size_t> layers(segments_);
  for (std::size_t a = 0; a < segments_; ++a) {
    std::vector<bool> is_taken(a + 1);
    for (std::size_t b = 0; b < a; ++b) {
      if (Overlaps(a, b)) {
        is_taken[layers[b]] = true;
      }
    }
    layers[a] = static_cast<std::size_t>(std::find(is_taken.begin(), is_taken.end(), false) -
                                         is_taken.begin());
  }
  return layers;
}

}  // namespace isoscope::source
