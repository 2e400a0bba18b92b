// The header of a band, 56 bytes, all numbers little-endian (docs/format/wire.md has the rest):
//
//    0  the magic ISPX
//    4  CRC-32C of all bytes from offset 8 on
//    8  version, flags (1: layers), two bytes that are 0
//   12  width and height of the image, first row of tiles, number of rows of tiles
//   28  numbers of pixels, tiles, dictionary entries, labels, colours
//   48  bytes of the side information, bytes of the extra bits
//
// ReadBandHeader refuses counts that contradict each other or the size of the band. So the decoder
// may allocate by them. AppendNumbers writes 5, 7, 6 as the differences 5, 2, -1, in zigzag 10, 4,
// 1: the bytes 10 4 1 of the lowest plane, then nine bytes 0.

#include "core/composite/band_format.h"

#include <array>
#include <utility>

#include "absl/strings/str_format.h"

#include "core/base/coding.h"
#include "core/base/crc32c.h"
#include "core/base/status_macros.h"
#include "core/composite/number_code.h"

namespace isoscope::composite {
namespace {

constexpr char kMagic[] = "ISPX";
constexpr std::size_t kMagicSize = 4;
constexpr std::size_t kChecksummedOffset = 8;
constexpr std::uint8_t kVersion = 2;
constexpr std::uint8_t kLayerFlag = 1;

// Whether the counts can be true together, and the band has the size that follows from them.
absl::Status CheckCounts(const BandHeader& header, std::size_t band_size) {
  if (header.tile_count < 1 || header.tile_count > header.pixel_count ||
      header.pixel_count > header.tile_count * kTilePixels ||
      header.dictionary_count < header.tile_count || header.dictionary_count > header.pixel_count ||
      header.label_count > header.pixel_count || header.palette_size > kMaxPaletteSize ||
      header.extras_size < kBandPaddingBytes) {
    return absl::DataLossError(absl::StrFormat(
        "pixel band: %d tiles, %d pixels, %d dictionary entries, %d labels, %d colours, %d bytes "
        "of extra bits",
        header.tile_count, header.pixel_count, header.dictionary_count, header.label_count,
        header.palette_size, header.extras_size));
  }
  const std::size_t size =
      kBandHeaderSize + header.frame_size + header.pixel_count + header.extras_size;
  if (band_size != size) {
    return absl::DataLossError(
        absl::StrFormat("pixel band of %d bytes; its header states %d", band_size, size));
  }
  return absl::OkStatus();
}

}  // namespace

std::string MakeBandHeader(const BandHeader& header, int width, int height) {
  std::string bytes;
  bytes.append(kMagic, kMagicSize);
  base::AppendLittleEndian(std::uint32_t{0}, &bytes);  // checksum
  base::AppendLittleEndian(kVersion, &bytes);
  base::AppendLittleEndian(header.is_layer ? kLayerFlag : std::uint8_t{0}, &bytes);
  base::AppendLittleEndian(std::uint16_t{0}, &bytes);
  for (const std::size_t field :
       {static_cast<std::size_t>(width), static_cast<std::size_t>(height),
        static_cast<std::size_t>(header.begin_row), static_cast<std::size_t>(header.row_count),
        header.pixel_count, header.tile_count, header.dictionary_count, header.label_count,
        header.palette_size, header.frame_size, header.extras_size}) {
    base::AppendLittleEndian(static_cast<std::uint32_t>(field), &bytes);
  }
  return bytes;
}

void SealBand(std::string* band) {
  base::StoreLittleEndian(base::Crc32c(absl::string_view(*band).substr(kChecksummedOffset)),
                          band->data() + kMagicSize);
}

absl::StatusOr<BandHeader> ReadBandHeader(absl::string_view band, const image::FrameImage& image) {
  if (band.size() < kBandHeaderSize || band.substr(0, kMagicSize) != kMagic) {
    return absl::DataLossError(
        absl::StrFormat("pixel band of %d bytes: no header of %d bytes with the magic %s",
                        band.size(), kBandHeaderSize, kMagic));
  }
  const auto stated = base::LoadLittleEndian<std::uint32_t>(band.data() + kMagicSize);
  const std::uint32_t actual = base::Crc32c(band.substr(kChecksummedOffset));
  if (stated != actual) {
    return absl::DataLossError(
        absl::StrFormat("pixel band of %d bytes: CRC-32C is %08x, the header states %08x",
                        band.size(), actual, stated));
  }
  base::Decoder decoder(band.substr(kChecksummedOffset));
  std::uint8_t version = 0;
  std::uint8_t flags = 0;
  std::uint16_t reserved = 0;
  std::array<std::uint32_t, 11> fields{};
  bool complete = decoder.Read(&version) && decoder.Read(&flags) && decoder.Read(&reserved);
  for (std::uint32_t& field : fields) {
    complete = complete && decoder.Read(&field);
  }
  if (!complete || version != kVersion || (flags & ~kLayerFlag) != 0 || reserved != 0) {
    return absl::DataLossError(
        absl::StrFormat("pixel band: version %d, flags %d, reserved %d; expected %d, 0 or %d, 0",
                        version, flags, reserved, kVersion, kLayerFlag));
  }
  const auto [width, height, begin_row, row_count, pixels, tiles, entries, labels, colors, frame,
              extras] = fields;
  if (width != static_cast<std::uint32_t>(image.width) ||
      height != static_cast<std::uint32_t>(image.height)) {
    return absl::DataLossError(
        absl::StrFormat("pixel band of an image of %d x %d pixels; expected %d x %d", width, height,
                        image.width, image.height));
  }
  const auto tile_rows = static_cast<std::uint32_t>(image.touched.rows());
  if (row_count < 1 || begin_row >= tile_rows || row_count > tile_rows - begin_row) {
    return absl::DataLossError(absl::StrFormat(
        "pixel band of tile rows [%d, +%d): the image has %d", begin_row, row_count, tile_rows));
  }
  BandHeader header;
  header.is_layer = flags == kLayerFlag;
  header.begin_row = static_cast<int>(begin_row);
  header.row_count = static_cast<int>(row_count);
  header.pixel_count = pixels;
  header.tile_count = tiles;
  header.dictionary_count = entries;
  header.label_count = labels;
  header.palette_size = colors;
  header.frame_size = frame;
  header.extras_size = extras;
  ISOSCOPE_RETURN_IF_ERROR(CheckCounts(header, band.size()));
  return header;
}

void AppendNumbers(const std::vector<std::uint32_t>& numbers, std::string* out) {
  const std::size_t begin = out->size();
  out->resize(begin + 4 * numbers.size());
  char* const bytes = out->data() + begin;
  std::uint32_t previous = 0;
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    const std::uint32_t number = ZigZag(numbers[i] - std::exchange(previous, numbers[i]));
    for (std::size_t plane = 0; plane < 4; ++plane) {
      bytes[plane * numbers.size() + i] = static_cast<char>(number >> (8 * plane) & 0xff);
    }
  }
}

std::vector<std::uint32_t> ReadNumbers(absl::string_view planes, std::size_t count) {
  std::vector<std::uint32_t> numbers(count);
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(planes.data());
  std::uint32_t previous = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint32_t number = std::uint32_t{bytes[i]} | std::uint32_t{bytes[i + count]} << 8 |
                                 std::uint32_t{bytes[i + 2 * count]} << 16 |
                                 std::uint32_t{bytes[i + 3 * count]} << 24;
    numbers[i] = previous += UnZigZag(number);
  }
  return numbers;
}

}  // namespace isoscope::composite
