#include "core/composite/pixel_codec.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstring>
#include <memory>
#include <span>
#include <utility>

#include "absl/status/statusor.h"
#include "absl/strings/str_format.h"
#include "absl/synchronization/mutex.h"
#include <oneapi/tbb/parallel_for.h>

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/compression.h"
#include "core/base/crc32c.h"
#include "core/base/large_pages.h"
#include "core/base/status_macros.h"
#include "core/composite/number_code.h"
#include "core/composite/tile_prediction.h"
#include "core/image/tile_coverage.h"

namespace isoscope::composite {
namespace {

using image::TileSet;

constexpr char kMagic[] = "ISPX";
constexpr std::size_t kMagicSize = 4;
constexpr std::size_t kChecksummedOffset = 8;
constexpr std::size_t kHeaderSize = 56;
constexpr std::uint8_t kVersion = 2;
// What follows the extra bits, so that reading 8 bytes at once never leaves the band.
constexpr std::size_t kPaddingBytes = 8;
// Of a tile: coverage, dictionary size.
constexpr std::size_t kMaxTileOverhead = 2 * kTilePx + 1;
// If each pixel has a block of its own: block id, label, control byte, extra bits.
constexpr std::size_t kMaxPixelBytes = 4 + 1 + 1 + 4 + 4;
// Header, palette, and what Zstandard adds to bytes that it can't make less of.
constexpr std::size_t kMaxFixedBytes = std::size_t{1} << 15;
// One row of tiles of the widest image, with its bits of presence, must fit into a band.
constexpr std::size_t kMaxColumns = 16384 / kTilePx;
static_assert((kMaxTileOverhead + kTilePixels * kMaxPixelBytes) * kMaxColumns + kMaxColumns / 8 +
                  kMaxFixedBytes <
              kMaxBandBytes);
// Fewer do not pay for a band of their own; more bands than wanted do not keep more cores busy.
constexpr std::size_t kMinBandPixels = std::size_t{1} << 14;
constexpr std::size_t kBandsWanted = 16;
constexpr std::uint32_t kOneBits = std::bit_cast<std::uint32_t>(1.0F);
// Bands of more colours send each as it is.
constexpr std::size_t kMaxPaletteSize = 2048;

// A colour as a number whose order groups similar ones: red first.
std::uint32_t NumberOf(image::Rgba8 color) {
  return std::uint32_t{color.r} << 24 | std::uint32_t{color.g} << 16 | std::uint32_t{color.b} << 8 |
         color.a;
}
image::Rgba8 ColorOf(std::uint32_t number) {
  return {static_cast<std::uint8_t>(number >> 24), static_cast<std::uint8_t>(number >> 16),
          static_cast<std::uint8_t>(number >> 8), static_cast<std::uint8_t>(number)};
}

// Part of the tile inside the image.
struct TileArea {
  int x;
  int y;
  int columns;
  int rows;
};

TileArea AreaOf(int tile_x, int tile_y, const image::FrameImage& image) {
  const int x = tile_x * kTilePx;
  const int y = tile_y * kTilePx;
  return {x, y, std::min(kTilePx, image.width - x), std::min(kTilePx, image.height - y)};
}

// The colours of a band, and their indices when they are sorted.
class Palette {
 public:
  static constexpr std::uint16_t kNone = 0xffff;

  // Where `number` is kept; it is added if it is new. kNone once there are too many.
  std::uint16_t SlotOf(std::uint32_t number) {
    // Colours of one material, of the same red, differ little in green and blue: their low bits
    // tell them apart.
    std::size_t at = (number >> 20 & 0xff0) | (number >> 14 & 12) | (number >> 8 & 3);
    while (numbers_[at] != number || indices_[at] == kNone) {
      if (indices_[at] == kNone) {
        if (size_ == kMaxPaletteSize) {
          return kNone;
        }
        numbers_[at] = number;
        indices_[at] = 0;
        ++size_;
        break;
      }
      at = (at + 1) % numbers_.size();
    }
    return static_cast<std::uint16_t>(at);
  }

  // The colours, sorted; from now on IndexOf is what is known of a slot.
  std::vector<std::uint32_t> Sort() {
    std::vector<std::uint64_t> sorted;  // number, slot
    sorted.reserve(size_);
    for (std::size_t at = 0; at < numbers_.size(); ++at) {
      if (indices_[at] != kNone) {
        sorted.push_back(std::uint64_t{numbers_[at]} << 32 | at);
      }
    }
    std::sort(sorted.begin(), sorted.end());
    std::vector<std::uint32_t> numbers(sorted.size());
    for (std::size_t i = 0; i < sorted.size(); ++i) {
      numbers[i] = static_cast<std::uint32_t>(sorted[i] >> 32);
      indices_[static_cast<std::uint32_t>(sorted[i])] = static_cast<std::uint16_t>(i);
    }
    return numbers;
  }

  // The place of a slot's colour among the sorted ones.
  [[nodiscard]] std::uint32_t IndexOf(std::uint16_t slot) const { return indices_[slot]; }

 private:
  static constexpr std::size_t kSlotCount = 2 * kMaxPaletteSize;

  std::array<std::uint32_t, kSlotCount> numbers_;
  std::array<std::uint16_t, kSlotCount> indices_ = [] {
    std::array<std::uint16_t, kSlotCount> none;
    none.fill(kNone);
    return none;
  }();
  std::size_t size_ = 0;
};

// Writes bits, the first into the lowest bit of the first byte.
class BitWriter {
 public:
  explicit BitWriter(char* out) : out_(out) {}

  // REQUIRES: count <= 57; 8 bytes may be written from where the writer is.
  void Put(std::uint64_t bits, unsigned count) {
    pending_ |= bits << pending_count_;
    pending_count_ += count;
    std::memcpy(out_, &pending_, sizeof(pending_));
    out_ += pending_count_ / 8;
    pending_ >>= pending_count_ & ~7U;
    pending_count_ &= 7;
  }
  // The end of what was written.
  [[nodiscard]] char* Finish() { return out_ + (pending_count_ != 0 ? 1 : 0); }

 private:
  char* out_;
  std::uint64_t pending_ = 0;
  unsigned pending_count_ = 0;
};

// What is in a band besides control bytes and extra bits.
struct SideInfo {
  std::vector<std::uint64_t> present;  // a bit a tile; a row of tiles begins at a word
  std::vector<TileMask> masks;         // of tiles with a covered pixel
  std::vector<std::uint8_t> dictionary_sizes;
  std::vector<std::uint32_t> dictionaries;  // block ids
  std::vector<std::uint8_t> labels;
};

// The dictionary of one tile.
class TileDictionary {
 public:
  // The index of `id`, which is added if it is new.
  std::uint8_t IndexOf(std::uint32_t id) {
    if (size_ == 0 || ids_[last_] != id) {
      // Along an edge two blocks take turns.
      std::swap(last_, before_);
      if (size_ == 0 || ids_[last_] != id) {
        last_ = static_cast<std::size_t>(std::find(ids_.begin(), ids_.begin() + size_, id) -
                                         ids_.begin());
        if (last_ == static_cast<std::size_t>(size_)) {
          ids_[last_] = id;
          ++size_;
        }
      }
    }
    return static_cast<std::uint8_t>(last_);
  }
  [[nodiscard]] std::span<const std::uint32_t> ids() const {
    return {ids_.data(), static_cast<std::size_t>(size_)};
  }

 private:
  std::array<std::uint32_t, kTilePixels> ids_;
  std::ptrdiff_t size_ = 0;
  std::size_t last_ = 0;    // of the pixel before
  std::size_t before_ = 0;  // another one before
};

std::size_t RowWords(const TileSet& tiles) {
  return static_cast<std::size_t>((tiles.columns() + 63) / 64);
}

// Appends 4 planes: the lowest bytes of all numbers, then the next.
void AppendPlanes(const std::vector<std::uint32_t>& numbers, std::string* out) {
  const std::size_t begin = out->size();
  out->resize(begin + 4 * numbers.size());
  for (std::size_t plane = 0; plane < 4; ++plane) {
    char* bytes = out->data() + begin + plane * numbers.size();
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      bytes[i] = static_cast<char>(numbers[i] >> (8 * plane) & 0xff);
    }
  }
}

// Joins 4 planes of `count` bytes.
std::vector<std::uint32_t> JoinPlanes(absl::string_view planes, std::size_t count) {
  std::vector<std::uint32_t> numbers(count);
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(planes.data());
  for (std::size_t i = 0; i < count; ++i) {
    numbers[i] = std::uint32_t{bytes[i]} | std::uint32_t{bytes[i + count]} << 8 |
                 std::uint32_t{bytes[i + 2 * count]} << 16 |
                 std::uint32_t{bytes[i + 3 * count]} << 24;
  }
  return numbers;
}

template <typename T>
void AppendBytes(const std::vector<T>& values, std::string* out) {
  out->append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
}

// Block ids and palettes: the difference to the one before is what is sent.
void ToDifferences(std::vector<std::uint32_t>* numbers) {
  std::uint32_t previous = 0;
  for (std::uint32_t& number : *numbers) {
    number = ZigZag(number - std::exchange(previous, number));
  }
}
void FromDifferences(std::vector<std::uint32_t>* numbers) {
  std::uint32_t previous = 0;
  for (std::uint32_t& number : *numbers) {
    number = previous += UnZigZag(number);
  }
}

// The tiles of one row that have a covered pixel.
struct TileRow {
  std::vector<TileArea> areas;
  std::vector<TileMask> masks;
  std::size_t pixel_count = 0;
};

TileRow FindCovered(const image::FrameImage& image, int tile_y) {
  TileRow row;
  image.touched.ForEachInRow(tile_y, [&](int tile_x) {
    const TileArea area = AreaOf(tile_x, tile_y, image);
    const TileMask mask = image::CoverageOf(image.keys.data() + image.IndexOf(area.x, area.y),
                                            static_cast<std::size_t>(image.width), area.columns,
                                            area.rows, image::kBackgroundKey);
    if (mask != TileMask{}) {
      row.areas.push_back(area);
      row.masks.push_back(mask);
      row.pixel_count += static_cast<std::size_t>(PixelCount(mask));
    }
  });
  return row;
}

// Rows of tiles [begin, end).
struct BandRows {
  int begin = 0;
  int end = 0;
};

// The bands of an image: none without a covered pixel, and not more than it needs, as each has a
// header, a palette and a Zstandard frame of its own.
std::vector<BandRows> CutIntoBands(const std::vector<TileRow>& rows, std::size_t row_bytes) {
  std::size_t pixels_in_all = 0;
  for (const TileRow& row : rows) {
    pixels_in_all += row.pixel_count;
  }
  const std::size_t pixels_wanted = std::max(kMinBandPixels, pixels_in_all / kBandsWanted);
  std::vector<BandRows> bands;
  std::size_t pixels = 0;
  std::size_t bytes = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (rows[i].pixel_count == 0) {
      continue;
    }
    const int row = static_cast<int>(i);
    const std::size_t more =
        rows[i].areas.size() * kMaxTileOverhead + rows[i].pixel_count * kMaxPixelBytes;
    const auto gap = bands.empty() ? 0 : static_cast<std::size_t>(row - bands.back().end);
    if (bands.empty() || pixels >= pixels_wanted ||
        bytes + more + (gap + 1) * row_bytes > static_cast<std::size_t>(kMaxBandBytes)) {
      bands.push_back({row, row});
      pixels = 0;
      bytes = kMaxFixedBytes;
    } else {
      bytes += gap * row_bytes;
    }
    bands.back().end = row + 1;
    pixels += rows[i].pixel_count;
    bytes += more + row_bytes;
  }
  return bands;
}

// Some rows of tiles of an image, the first and the last of them with a covered pixel.
class BandEncoder {
 public:
  BandEncoder(const image::FrameImage& image, BandRows rows, std::span<const TileRow> tiles)
      : image_(image), rows_(rows) {
    const std::size_t row_words = RowWords(image_.touched);
    side_.present.resize(row_words * tiles.size());
    for (std::size_t row = 0; row < tiles.size(); ++row) {
      for (const TileArea& area : tiles[row].areas) {
        const auto tile_x = static_cast<std::size_t>(area.x / kTilePx);
        side_.present[row_words * row + tile_x / 64] |= std::uint64_t{1} << (tile_x % 64);
      }
      areas_.insert(areas_.end(), tiles[row].areas.begin(), tiles[row].areas.end());
      side_.masks.insert(side_.masks.end(), tiles[row].masks.begin(), tiles[row].masks.end());
      pixel_count_ += tiles[row].pixel_count;
    }
  }

  std::string Encode() {
    FindColors();
    controls_ = std::make_unique_for_overwrite<std::uint8_t[]>(pixel_count_ + kClassifyPadding);
    extras_ = std::make_unique_for_overwrite<char[]>(2 * kMaxExtraBits / 8 * pixel_count_ +
                                                     kPaddingBytes);
    if (!palette_numbers_.empty()) {
      EncodePixels<true>();
    } else {
      EncodePixels<false>();
    }
    return Serialize();
  }

 private:
  // The palette, and which slot of it each covered pixel has.
  void FindColors() {
    slots_ = std::make_unique_for_overwrite<std::uint16_t[]>(pixel_count_);
    std::uint16_t* out = slots_.get();
    for (std::size_t tile = 0; tile < areas_.size(); ++tile) {
      for (std::size_t row = 0; row < kTilePx; ++row) {
        const std::uint32_t mask = side_.masks[tile][row];
        if (mask == 0) {
          continue;
        }
        const image::Rgba8* colors = RowOf(image_.colors, areas_[tile], row);
        for (std::uint32_t rest = mask; rest != 0; rest &= rest - 1) {
          const std::uint16_t slot = palette_.SlotOf(NumberOf(colors[std::countr_zero(rest)]));
          if (slot == Palette::kNone) {
            return;
          }
          *out++ = slot;
        }
      }
    }
    palette_numbers_ = palette_.Sort();
  }

  template <bool kHasPalette>
  void EncodePixels() {
    std::uint8_t* control = controls_.get();
    const std::uint16_t* slot = slots_.get();
    BitWriter extras(extras_.get());
    TilePrediction prediction;
    TileNumbers numbers{};
    TileNumbers differences{};
    std::array<std::uint32_t, kTilePixels> ids;
    for (std::size_t tile = 0; tile < areas_.size(); ++tile) {
      const TileMask& mask = side_.masks[tile];
      std::size_t count = 0;
      for (std::size_t row = 0; row < kTilePx; ++row) {
        if (mask[row] == 0) {
          continue;
        }
        const std::uint64_t* keys = RowOf(image_.keys, areas_[tile], row);
        const image::Rgba8* colors = RowOf(image_.colors, areas_[tile], row);
        for (std::uint32_t rest = mask[row]; rest != 0; rest &= rest - 1) {
          const auto column = static_cast<std::size_t>(std::countr_zero(rest));
          numbers.depths[count] = static_cast<std::uint32_t>(keys[column] >> 32);
          numbers.colors[count] =
              kHasPalette ? palette_.IndexOf(*slot++) : NumberOf(colors[column]);
          ids[count] = image::BlockOf(keys[column]);
          ++count;
        }
      }
      AddLabels(std::span(ids).first(count));
      prediction.Subtract(mask, numbers, &differences);
      ClassifyNumbers(differences.depths.data(), differences.colors.data(), count, control);
      for (std::size_t i = 0; i < count; ++i) {
        const Control& code = kControls[control[i]];
        const std::uint64_t depth_extra = differences.depths[i] - code.depth_base;
        const std::uint64_t color_extra = differences.colors[i] - code.color_base;
        if (kHasPalette) {
          extras.Put(depth_extra | color_extra << code.depth_bits, code.all_bits);
        } else {
          extras.Put(depth_extra, code.depth_bits);
          extras.Put(color_extra, code.all_bits - code.depth_bits);
        }
      }
      control += count;
    }
    extras_size_ = static_cast<std::size_t>(extras.Finish() - extras_.get());
    std::memset(extras_.get() + extras_size_, 0, kPaddingBytes);
    extras_size_ += kPaddingBytes;
  }

  // The dictionary of a tile, and which block each of its covered pixels has.
  void AddLabels(std::span<const std::uint32_t> ids) {
    TileDictionary dictionary;
    const std::size_t first = side_.labels.size();
    side_.labels.resize(first + ids.size());
    std::uint8_t* labels = side_.labels.data() + first;
    for (std::size_t i = 0; i < ids.size(); ++i) {
      labels[i] = dictionary.IndexOf(ids[i]);
    }
    const std::span<const std::uint32_t> known = dictionary.ids();
    if (known.size() == 1) {
      side_.labels.resize(first);
    }
    side_.dictionary_sizes.push_back(static_cast<std::uint8_t>(known.size() - 1));
    side_.dictionaries.insert(side_.dictionaries.end(), known.begin(), known.end());
  }

  std::string Serialize() {
    const std::size_t dictionary_count = side_.dictionaries.size();
    std::string side;
    side.reserve(8 * side_.present.size() + sizeof(TileMask) * areas_.size() + areas_.size() +
                 4 * dictionary_count + side_.labels.size() + 4 * palette_numbers_.size());
    AppendBytes(side_.present, &side);
    AppendBytes(side_.masks, &side);
    AppendBytes(side_.dictionary_sizes, &side);
    ToDifferences(&side_.dictionaries);
    AppendPlanes(side_.dictionaries, &side);
    AppendBytes(side_.labels, &side);
    ToDifferences(&palette_numbers_);
    AppendPlanes(palette_numbers_, &side);
    const std::string frame = base::Compress(side);

    std::string bytes;
    bytes.reserve(kHeaderSize + frame.size() + pixel_count_ + extras_size_);
    bytes.append(kMagic, kMagicSize);
    base::AppendLittleEndian(std::uint32_t{0}, &bytes);
    base::AppendLittleEndian(kVersion, &bytes);
    base::AppendLittleEndian(std::uint8_t{0}, &bytes);
    base::AppendLittleEndian(std::uint16_t{0}, &bytes);
    for (const std::size_t field :
         {static_cast<std::size_t>(image_.width), static_cast<std::size_t>(image_.height),
          static_cast<std::size_t>(rows_.begin), static_cast<std::size_t>(rows_.end - rows_.begin),
          pixel_count_, areas_.size(), dictionary_count, side_.labels.size(),
          palette_numbers_.size(), frame.size(), extras_size_}) {
      base::AppendLittleEndian(static_cast<std::uint32_t>(field), &bytes);
    }
    bytes += frame;
    bytes.append(reinterpret_cast<const char*>(controls_.get()), pixel_count_);
    bytes.append(extras_.get(), extras_size_);
    base::StoreLittleEndian(
        base::ExtendCrc32c(0, bytes.data() + kChecksummedOffset, bytes.size() - kChecksummedOffset),
        bytes.data() + kMagicSize);
    return bytes;
  }

  template <typename T>
  [[nodiscard]] const T* RowOf(const base::LargePageVector<T>& plane, const TileArea& area,
                               std::size_t row) const {
    return plane.data() + image_.IndexOf(area.x, area.y + static_cast<int>(row));
  }

  const image::FrameImage& image_;
  const BandRows rows_;
  SideInfo side_;
  std::vector<TileArea> areas_;  // of tiles with a covered pixel
  std::size_t pixel_count_ = 0;
  Palette palette_;
  std::vector<std::uint32_t> palette_numbers_;  // empty: colours are sent as they are
  std::unique_ptr<std::uint16_t[]> slots_;
  std::unique_ptr<std::uint8_t[]> controls_;
  std::unique_ptr<char[]> extras_;
  std::size_t extras_size_ = 0;
};

// The header of a band that fits `image`, checked.
struct Header {
  int begin_row = 0;
  int row_count = 0;
  std::size_t pixel_count = 0;
  std::size_t tile_count = 0;
  std::size_t dictionary_count = 0;
  std::size_t label_count = 0;
  std::size_t palette_size = 0;  // 0: colours are sent as they are
  std::size_t frame_size = 0;
  std::size_t extras_size = 0;
};

absl::StatusOr<Header> ReadHeader(absl::string_view band, const image::FrameImage& image) {
  if (band.size() < kHeaderSize || band.substr(0, kMagicSize) != kMagic) {
    return absl::DataLossError(
        absl::StrFormat("pixel band of %d bytes: no header of %d bytes with the magic %s",
                        band.size(), kHeaderSize, kMagic));
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
  if (!complete || version != kVersion || flags != 0 || reserved != 0) {
    return absl::DataLossError(
        absl::StrFormat("pixel band: version %d, flags %d, reserved %d; expected %d, 0, 0", version,
                        flags, reserved, kVersion));
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
  Header header;
  header.begin_row = static_cast<int>(begin_row);
  header.row_count = static_cast<int>(row_count);
  header.pixel_count = pixels;
  header.tile_count = tiles;
  header.dictionary_count = entries;
  header.label_count = labels;
  header.palette_size = colors;
  header.frame_size = frame;
  header.extras_size = extras;
  if (tiles < 1 || tiles > pixels || header.pixel_count > tiles * kTilePixels || entries < tiles ||
      entries > pixels || labels > pixels || colors > kMaxPaletteSize || extras < kPaddingBytes) {
    return absl::DataLossError(absl::StrFormat(
        "pixel band: %d tiles, %d pixels, %d dictionary entries, %d labels, %d colours, %d bytes "
        "of extra bits",
        tiles, pixels, entries, labels, colors, extras));
  }
  const std::size_t size =
      kHeaderSize + header.frame_size + header.pixel_count + header.extras_size;
  if (band.size() != size) {
    return absl::DataLossError(
        absl::StrFormat("pixel band of %d bytes; its header states %d", band.size(), size));
  }
  return header;
}

absl::Status Damaged(absl::string_view what) {
  return absl::DataLossError(absl::StrFormat("pixel band: %s", what));
}

// Decodes a band completely before the image is touched.
class BandDecoder {
 public:
  BandDecoder(absl::string_view band, const Header& header, const image::FrameImage& image)
      : header_(header),
        image_(image),
        frame_(band.substr(kHeaderSize, header.frame_size)),
        controls_(reinterpret_cast<const std::uint8_t*>(frame_.data()) + frame_.size()),
        extras_(reinterpret_cast<const char*>(controls_) + header.pixel_count),
        keys_(std::make_unique_for_overwrite<std::uint64_t[]>(header.pixel_count)),
        colors_(std::make_unique_for_overwrite<image::Rgba8[]>(header.pixel_count)) {}

  absl::Status Decode() {
    ISOSCOPE_RETURN_IF_ERROR(ReadSideInfo());
    ISOSCOPE_RETURN_IF_ERROR(CheckTiles());
    return header_.palette_size != 0 ? DecodePixels<true>() : DecodePixels<false>();
  }

  // REQUIRES: Decode returned OK.
  void CompositeInto(RowLocks* locks, image::FrameImage* into) const {
    Cursor cursor{.key = keys_.get(), .color = colors_.get()};
    for (std::size_t tile = 0; tile < areas_.size();) {
      const int tile_row = areas_[tile].y / kTilePx;
      const absl::MutexLockMaybe lock(locks == nullptr ? nullptr : &locks->OfTileRow(tile_row));
      for (; tile < areas_.size() && areas_[tile].y / kTilePx == tile_row; ++tile) {
        CompositeTile(tile, &cursor, into);
      }
    }
  }

 private:
  // The next pixel.
  struct Cursor {
    const std::uint64_t* key;
    const image::Rgba8* color;
  };

  void CompositeTile(std::size_t tile, Cursor* cursor, image::FrameImage* into) const {
    const TileArea& area = areas_[tile];
    into->touched.Insert(area.x / kTilePx, area.y / kTilePx);
    for (std::size_t row = 0; row < kTilePx; ++row) {
      const std::uint32_t mask = side_.masks[tile][row];
      if (mask == 0) {
        continue;
      }
      const std::size_t first = into->IndexOf(area.x, area.y + static_cast<int>(row));
      std::uint64_t* keys = into->keys.data() + first;
      image::Rgba8* colors = into->colors.data() + first;
      for (std::uint32_t rest = mask; rest != 0; rest &= rest - 1, ++cursor->key, ++cursor->color) {
        const int column = std::countr_zero(rest);
        if (*cursor->key < keys[column]) {
          keys[column] = *cursor->key;
          colors[column] = *cursor->color;
        }
      }
    }
  }

  absl::Status ReadSideInfo() {
    const std::size_t present_count =
        RowWords(image_.touched) * static_cast<std::size_t>(header_.row_count);
    const std::size_t size = 8 * present_count + sizeof(TileMask) * header_.tile_count +
                             header_.tile_count + 4 * header_.dictionary_count +
                             header_.label_count + 4 * header_.palette_size;
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string side, base::Decompress(frame_, size));
    if (side.size() != size) {
      return Damaged("the side information does not have the size that the header states");
    }
    const char* at = side.data();
    const auto read = [&at](std::size_t count, auto* values) {
      values->resize(count);
      const std::size_t bytes = count * sizeof((*values)[0]);
      if (bytes != 0) {
        std::memcpy(values->data(), at, bytes);
      }
      at += bytes;
    };
    const auto read_planes = [&at](std::size_t count) {
      std::vector<std::uint32_t> numbers = JoinPlanes({at, 4 * count}, count);
      at += 4 * count;
      FromDifferences(&numbers);
      return numbers;
    };
    read(present_count, &side_.present);
    read(header_.tile_count, &side_.masks);
    read(header_.tile_count, &side_.dictionary_sizes);
    side_.dictionaries = read_planes(header_.dictionary_count);
    read(header_.label_count, &side_.labels);
    for (const std::uint32_t number : read_planes(header_.palette_size)) {
      palette_.push_back(ColorOf(number));
    }
    return absl::OkStatus();
  }

  // Finds where tiles are; checks coverage, dictionaries and labels.
  absl::Status CheckTiles() {
    const int columns = image_.touched.columns();
    const std::size_t row_words = RowWords(image_.touched);
    areas_.reserve(header_.tile_count);
    for (std::size_t word = 0; word < side_.present.size(); ++word) {
      const int tile_y = header_.begin_row + static_cast<int>(word / row_words);
      for (std::uint64_t rest = side_.present[word]; rest != 0; rest &= rest - 1) {
        const int tile_x = 64 * static_cast<int>(word % row_words) + std::countr_zero(rest);
        if (tile_x >= columns || areas_.size() == header_.tile_count) {
          return Damaged("there are other tiles than the header states");
        }
        areas_.push_back(AreaOf(tile_x, tile_y, image_));
      }
    }
    if (areas_.size() != header_.tile_count) {
      return Damaged("there are fewer tiles than the header states");
    }
    std::size_t pixel_count = 0;
    std::size_t entry_count = 0;
    std::size_t label_count = 0;
    for (std::size_t tile = 0; tile < areas_.size(); ++tile) {
      const TileMask& mask = side_.masks[tile];
      const std::uint32_t inside = (1U << areas_[tile].columns) - 1;
      for (int row = 0; row < kTilePx; ++row) {
        if ((mask[static_cast<std::size_t>(row)] & ~(row < areas_[tile].rows ? inside : 0)) != 0) {
          return Damaged("the coverage of a tile reaches outside the image");
        }
      }
      const auto pixels = static_cast<std::size_t>(PixelCount(mask));
      if (pixels == 0) {
        return Damaged("a tile has no covered pixel");
      }
      pixel_count += pixels;
      const std::size_t entries = std::size_t{side_.dictionary_sizes[tile]} + 1;
      entry_count += entries;
      if (entries > 1) {
        if (pixels > side_.labels.size() - label_count) {
          return Damaged("labels are missing");
        }
        const auto first = side_.labels.begin() + static_cast<std::ptrdiff_t>(label_count);
        if (*std::max_element(first, first + static_cast<std::ptrdiff_t>(pixels)) >= entries) {
          return Damaged("a label points outside its dictionary");
        }
        label_count += pixels;
      }
    }
    if (pixel_count != header_.pixel_count || entry_count != header_.dictionary_count ||
        label_count != header_.label_count) {
      return Damaged("the tiles do not have as many pixels, entries, labels as the header states");
    }
    for (const std::uint32_t id : side_.dictionaries) {
      if (id == image::kNoBlock) {
        return Damaged("a covered pixel belongs to no block");
      }
    }
    // Reading 8 bytes from the byte of any bit stays inside, because of the padding.
    std::size_t bit_count = 0;
    for (std::size_t i = 0; i < header_.pixel_count; ++i) {
      bit_count += kControls[controls_[i]].all_bits;
    }
    if ((bit_count + 7) / 8 + kPaddingBytes != header_.extras_size) {
      return Damaged("there are not as many extra bits as the control bytes say");
    }
    return absl::OkStatus();
  }

  template <bool kHasPalette>
  absl::Status DecodePixels() {
    const std::uint8_t* control = controls_;
    std::uint64_t* key = keys_.get();
    image::Rgba8* color = colors_.get();
    const std::uint8_t* label = side_.labels.data();
    const std::uint32_t* dictionary = side_.dictionaries.data();
    std::size_t bit = 0;
    std::uint32_t largest_depth = 0;
    std::uint32_t largest_color = 0;
    const auto palette_size = static_cast<std::uint32_t>(palette_.size());
    TilePrediction prediction;
    TileNumbers differences;
    TileNumbers numbers;
    for (std::size_t tile = 0; tile < areas_.size(); ++tile) {
      const TileMask& mask = side_.masks[tile];
      const auto count = static_cast<std::size_t>(PixelCount(mask));
      for (std::size_t i = 0; i < count; ++i) {
        const Control& code = kControls[control[i]];
        const unsigned color_bits = code.all_bits - code.depth_bits;
        const std::uint64_t depth_extra = BitsFrom(bit);
        // At least 57 bits: enough for both, but for colours that are sent as they are.
        const std::uint64_t color_extra =
            kHasPalette ? depth_extra >> code.depth_bits : BitsFrom(bit + code.depth_bits);
        bit += code.all_bits;
        differences.depths[i] = code.depth_base + LowBits(depth_extra, code.depth_bits);
        differences.colors[i] = code.color_base + LowBits(color_extra, color_bits);
      }
      prediction.Add(mask, differences, &numbers);
      const std::size_t entries = std::size_t{side_.dictionary_sizes[tile]} + 1;
      for (std::size_t i = 0; i < count; ++i) {
        largest_depth = std::max(largest_depth, numbers.depths[i]);
        key[i] = std::uint64_t{numbers.depths[i]} << 32 | dictionary[entries == 1 ? 0 : label[i]];
      }
      for (std::size_t i = 0; i < count; ++i) {
        if (kHasPalette) {
          largest_color = std::max(largest_color, numbers.colors[i]);
          color[i] = palette_[std::min(numbers.colors[i], palette_size - 1)];
        } else {
          color[i] = ColorOf(numbers.colors[i]);
        }
      }
      control += count;
      key += count;
      color += count;
      label += entries == 1 ? 0 : count;
      dictionary += entries;
    }
    if (largest_depth > kOneBits) {
      return Damaged("a depth is not in [0, 1]");
    }
    if (kHasPalette && largest_color >= palette_size) {
      return Damaged("a colour is not in the palette");
    }
    return absl::OkStatus();
  }

  // At least 57 bits, the first of them `bit`.
  [[nodiscard]] std::uint64_t BitsFrom(std::size_t bit) const {
    return base::LoadLittleEndian<std::uint64_t>(extras_ + bit / 8) >> (bit % 8);
  }
  static std::uint32_t LowBits(std::uint64_t bits, unsigned count) {
    return static_cast<std::uint32_t>(bits & ((std::uint64_t{1} << count) - 1));
  }

  const Header& header_;
  const image::FrameImage& image_;
  const absl::string_view frame_;
  const std::uint8_t* const controls_;
  const char* const extras_;
  SideInfo side_;
  std::vector<TileArea> areas_;
  std::vector<image::Rgba8> palette_;
  // Of the covered pixels, in order.
  std::unique_ptr<std::uint64_t[]> keys_;
  std::unique_ptr<image::Rgba8[]> colors_;
};

}  // namespace

std::vector<std::string> EncodePixels(const image::FrameImage& image) {
  std::vector<TileRow> rows(static_cast<std::size_t>(image.touched.rows()));
  tbb::parallel_for(std::size_t{0}, rows.size(), [&](std::size_t row) {
    rows[row] = FindCovered(image, static_cast<int>(row));
  });
  const std::vector<BandRows> cuts = CutIntoBands(rows, 8 * RowWords(image.touched));
  std::vector<std::string> bands(cuts.size());
  tbb::parallel_for(std::size_t{0}, bands.size(), [&](std::size_t i) {
    const auto begin = static_cast<std::size_t>(cuts[i].begin);
    const auto count = static_cast<std::size_t>(cuts[i].end - cuts[i].begin);
    bands[i] = BandEncoder(image, cuts[i], std::span(rows).subspan(begin, count)).Encode();
  });
  return bands;
}

RowLocks::RowLocks(int height_px)
    : mutexes_(std::make_unique<absl::Mutex[]>(
          static_cast<std::size_t>((height_px + kTilePx - 1) / kTilePx))) {}

absl::Status DecodePixelsInto(absl::string_view band, image::FrameImage* into, RowLocks* locks) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Header header, ReadHeader(band, *into));
  BandDecoder decoder(band, header, *into);
  ISOSCOPE_RETURN_IF_ERROR(decoder.Decode());
  decoder.CompositeInto(locks, into);
  return absl::OkStatus();
}

}  // namespace isoscope::composite
