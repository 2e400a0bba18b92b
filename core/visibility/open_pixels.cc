// The masks of all blocks as one string of bits, whole or as one Zstandard frame if that is
// smaller.
//
//   header, 24 bytes: magic, CRC-32C of the rest, version, form, count of masks, count of bits
//   body: mask after mask without gaps, lowest bit first, the last byte filled up with 0
//
// Masks begin at any bit: a word of a mask is spread over two words of the string by a shift.
// Shapes are not sent, because a mask's shape follows from the block's rectangle (ClosedMaskOf),
// which the agent knows. Example: rectangles of 40 x 10 pixels at pixel 0 need cells of 2 x 2
// pixels to have at most 32 columns: 20 x 5 cells. Two such masks take 200 bits, 25 bytes; the
// second begins at bit 36 of the second word.
//
// Invariant of the decoder: it compares counts with the shapes it expects before it allocates by
// them, and refuses bits after the last mask.
//
// Layout: docs/format/wire.md, "Open pixels".

#include "core/visibility/open_pixels.h"

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "absl/status/status.h"
#include "absl/strings/str_format.h"

#include "core/base/coding.h"
#include "core/base/compression.h"
#include "core/base/crc32c.h"
#include "core/base/status_macros.h"
#include "core/visibility/occlusion_map.h"

namespace isoscope::visibility {
namespace {

constexpr char kMagic[] = "ISOP";
constexpr std::size_t kMagicSize = 4;
constexpr std::size_t kChecksummedOffset = 8;
constexpr std::size_t kHeaderSize = 24;
constexpr std::uint8_t kVersion = 1;
constexpr std::uint8_t kStored = 0;
constexpr std::uint8_t kZstandard = 1;

std::size_t BitCount(const image::PixelMask& mask) {
  return static_cast<std::size_t>(mask.columns) * static_cast<std::size_t>(mask.rows);
}

std::size_t WordCount(std::uint64_t bits) { return static_cast<std::size_t>((bits + 63) / 64); }

// Concatenates the bits of the masks, `total` bits, without gaps.
std::vector<std::uint64_t> Concatenate(std::span<const image::PixelMask> masks,
                                       std::uint64_t total) {
  std::vector<std::uint64_t> all(WordCount(total) + 1);  // one more: the carry needs no test
  std::uint64_t position = 0;
  for (const image::PixelMask& mask : masks) {
    std::size_t word = static_cast<std::size_t>(position / 64);
    const unsigned offset = static_cast<unsigned>(position % 64);
    for (const std::uint64_t bits : mask.words) {
      all[word] |= bits << offset;
      all[++word] |= offset == 0 ? 0 : bits >> (64 - offset);
    }
    position += BitCount(mask);
  }
  all.resize(WordCount(total));
  return all;
}

// The inverse of Concatenate: fills the words of each mask from `all`, which has one word more than
// its bits.
void Split(std::span<const std::uint64_t> all, std::span<image::PixelMask> masks) {
  std::uint64_t position = 0;
  for (image::PixelMask& mask : masks) {
    std::size_t word = static_cast<std::size_t>(position / 64);
    const unsigned offset = static_cast<unsigned>(position % 64);
    for (std::uint64_t& bits : mask.words) {
      bits = all[word] >> offset;
      ++word;
      bits |= offset == 0 ? 0 : all[word] << (64 - offset);
    }
    const std::size_t spare = BitCount(mask) % 64;
    if (spare != 0) {
      mask.words.back() &= (std::uint64_t{1} << spare) - 1;
    }
    position += BitCount(mask);
  }
}

struct Header {
  std::uint8_t form = kStored;
  std::uint32_t mask_count = 0;
  std::uint64_t bit_count = 0;
};

// Verifies magic, checksum and version. DATA_LOSS if one is wrong.
absl::StatusOr<Header> DecodeHeader(absl::string_view bytes) {
  if (bytes.size() < kHeaderSize || bytes.substr(0, kMagicSize) != kMagic) {
    return absl::DataLossError(
        absl::StrFormat("open pixels of %d bytes: no header of %d bytes with the magic %s",
                        bytes.size(), kHeaderSize, kMagic));
  }
  const auto stated_crc = base::LoadLittleEndian<std::uint32_t>(bytes.data() + kMagicSize);
  const std::uint32_t actual_crc = base::Crc32c(bytes.substr(kChecksummedOffset));
  if (stated_crc != actual_crc) {
    return absl::DataLossError(
        absl::StrFormat("open pixels of %d bytes: CRC-32C is %08x, the header states %08x",
                        bytes.size(), actual_crc, stated_crc));
  }
  base::Decoder decoder(bytes.substr(kChecksummedOffset));
  Header header;
  std::uint8_t version = 0;
  std::uint16_t reserved = 0;
  const bool complete = decoder.Read(&version) && decoder.Read(&header.form) &&
                        decoder.Read(&reserved) && decoder.Read(&header.mask_count) &&
                        decoder.Read(&header.bit_count);
  if (!complete || version != kVersion || header.form > kZstandard || reserved != 0) {
    return absl::DataLossError(
        absl::StrFormat("open pixels: version %d, form %d, reserved %d; expected %d, 0 or 1, 0",
                        version, header.form, reserved, kVersion));
  }
  return header;
}

}  // namespace

std::string EncodeOpenPixels(std::span<const image::PixelMask> masks) {
  std::uint64_t total = 0;
  for (const image::PixelMask& mask : masks) {
    total += BitCount(mask);
  }
  const std::vector<std::uint64_t> all = Concatenate(masks, total);
  const absl::string_view stored(reinterpret_cast<const char*>(all.data()),
                                 static_cast<std::size_t>((total + 7) / 8));
  const std::string compressed = base::Compress(stored);
  const bool shrinks = compressed.size() < stored.size();
  const absl::string_view body = shrinks ? absl::string_view(compressed) : stored;

  std::string bytes;
  bytes.reserve(kHeaderSize + body.size());
  bytes.append(kMagic, kMagicSize);
  base::AppendLittleEndian(std::uint32_t{0}, &bytes);
  base::AppendLittleEndian(kVersion, &bytes);
  base::AppendLittleEndian(shrinks ? kZstandard : kStored, &bytes);
  base::AppendLittleEndian(std::uint16_t{0}, &bytes);
  base::AppendLittleEndian(static_cast<std::uint32_t>(masks.size()), &bytes);
  base::AppendLittleEndian(total, &bytes);
  bytes.append(body.data(), body.size());
  base::StoreLittleEndian(
      base::ExtendCrc32c(0, bytes.data() + kChecksummedOffset, bytes.size() - kChecksummedOffset),
      bytes.data() + kMagicSize);
  return bytes;
}

absl::StatusOr<std::vector<image::PixelMask>> DecodeOpenPixels(
    absl::string_view bytes, std::span<const view::PixelRect> rects) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Header header, DecodeHeader(bytes));
  std::vector<image::PixelMask> masks;
  masks.reserve(rects.size());
  std::uint64_t total = 0;
  for (const view::PixelRect& rect : rects) {
    masks.push_back(ClosedMaskOf(rect));
    total += BitCount(masks.back());
  }
  if (header.mask_count != rects.size() || header.bit_count != total) {
    return absl::DataLossError(
        absl::StrFormat("open pixels of %d masks with %d bits; expected %d with %d",
                        header.mask_count, header.bit_count, rects.size(), total));
  }
  const auto size = static_cast<std::size_t>((total + 7) / 8);
  absl::string_view stored = bytes.substr(kHeaderSize);
  std::string decompressed;
  if (header.form == kZstandard) {
    ISOSCOPE_ASSIGN_OR_RETURN(decompressed, base::Decompress(stored, size));
    stored = decompressed;
  }
  if (stored.size() != size) {
    return absl::DataLossError(absl::StrFormat("open pixels of %d bits in %d bytes; expected %d",
                                               total, stored.size(), size));
  }
  // Whole words, and one more: the carry needs no test.
  std::vector<std::uint64_t> all(WordCount(total) + 1);
  std::memcpy(all.data(), stored.data(), size);
  if (total % 64 != 0 && all[static_cast<std::size_t>(total / 64)] >> (total % 64) != 0) {
    return absl::DataLossError("open pixels: bits are set after the last mask");
  }
  Split(all, masks);
  return masks;
}

}  // namespace isoscope::visibility
