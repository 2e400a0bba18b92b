#include "core/composite/pixel_codec.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <utility>

#include "absl/status/statusor.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/compression.h"
#include "core/base/crc32c.h"
#include "core/base/status_macros.h"

namespace isoscope::composite {
namespace {

constexpr int kTilePx = 8;
constexpr std::size_t kTilePixels = std::size_t{kTilePx} * kTilePx;
constexpr char kMagic[] = "ISPX";
constexpr std::size_t kMagicSize = 4;
constexpr std::size_t kChecksummedOffset = 8;
constexpr std::size_t kHeaderSize = 40;
constexpr std::uint8_t kVersion = 1;
// A full tile of as many blocks as pixels: mask, dictionary size, and for each pixel an id, an
// index, depth and colour.
constexpr std::int64_t kMaxTileBytes = 8 + 1 + kTilePixels * (4 + 1 + 4 + 3);
constexpr std::uint32_t kOneBits = std::bit_cast<std::uint32_t>(1.0F);

constexpr std::uint32_t ZigZag(std::uint32_t difference) {
  return difference << 1 ^ (0U - (difference >> 31));
}
constexpr std::uint32_t UnZigZag(std::uint32_t code) { return code >> 1 ^ (0U - (code & 1)); }

constexpr std::uint8_t Low8(std::uint32_t x) { return static_cast<std::uint8_t>(x); }

// A covered pixel as it is predicted from another.
struct Pixel {
  std::uint32_t depth_bits = 0;
  std::uint8_t r = 0;
  std::uint8_t g_minus_r = 0;
  std::uint8_t b_minus_g = 0;
};

// Walks the predecessors of docs/format/wire.md: `Of(row)` is where the pixel that comes next, in
// `row` of its tile, has its predecessor, and where it must then be stored.
class Predecessor {
 public:
  void BeginTile() { row_ = -1; }
  Pixel& Of(int row) {
    if (row != row_) {
      previous_ = first_of_row_;
      is_first_ = true;
      row_ = row;
    }
    return previous_;
  }
  void Stored() {
    if (is_first_) {
      first_of_row_ = previous_;
      if (!tile_started_) {
        tile_started_ = true;
        first_of_tile_ = previous_;
      }
      is_first_ = false;
    }
  }
  void EndTile() {
    first_of_row_ = first_of_tile_;
    tile_started_ = false;
  }

 private:
  Pixel previous_;
  Pixel first_of_row_;
  Pixel first_of_tile_;
  int row_ = -1;
  bool is_first_ = true;
  bool tile_started_ = false;
};

// What a band holds, before it is split into planes.
struct Band {
  std::vector<std::uint64_t> masks;
  std::vector<std::uint8_t> dictionary_sizes;
  std::vector<std::uint32_t> dictionaries;  // zigzag differences
  std::vector<std::uint8_t> indices;
  std::vector<std::uint32_t> depths;  // zigzag differences
  std::array<std::vector<std::uint8_t>, 3> colors;

  void Clear() {
    masks.clear();
    dictionary_sizes.clear();
    dictionaries.clear();
    indices.clear();
    depths.clear();
    for (auto& plane : colors) {
      plane.clear();
    }
  }
};

void AppendPlanes(const std::vector<std::uint32_t>& values, std::string* out) {
  const std::size_t count = values.size();
  const std::size_t begin = out->size();
  out->resize(begin + 4 * count);
  for (std::size_t plane = 0; plane < 4; ++plane) {
    char* bytes = out->data() + begin + plane * count;
    const std::uint32_t* from = values.data();
    for (std::size_t i = 0; i < count; ++i) {
      bytes[i] = static_cast<char>(from[i] >> (8 * plane) & 0xff);
    }
  }
}

template <typename T>
void AppendBytes(const std::vector<T>& values, std::string* out) {
  out->append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
}

// The dictionary of one tile.
class TileDictionary {
 public:
  // The index of `id`, which is added if it is new.
  std::uint8_t IndexOf(std::uint32_t id) {
    if (size_ > 0 && ids_[last_] == id) {
      return Low8(last_);
    }
    for (last_ = 0; last_ < size_; ++last_) {
      if (ids_[last_] == id) {
        return Low8(last_);
      }
    }
    ids_[size_++] = id;
    return Low8(last_);
  }
  [[nodiscard]] std::uint32_t size() const { return size_; }
  [[nodiscard]] std::uint32_t id(std::uint32_t index) const { return ids_[index]; }

 private:
  std::array<std::uint32_t, kTilePixels> ids_;
  std::uint32_t size_ = 0;
  std::uint32_t last_ = 0;
};

// Part of the tile inside the image.
struct TileArea {
  int x;
  int y;
  int columns;
  int rows;
};

TileArea AreaOf(int tile_x, int tile_y, int width, int height) {
  const int x = tile_x * kTilePx;
  const int y = tile_y * kTilePx;
  return {x, y, std::min(kTilePx, width - x), std::min(kTilePx, height - y)};
}

std::uint64_t CoverageMask(const image::FrameImage& image, const TileArea& area,
                           const std::function<bool(int x, int y)>& keep) {
  std::uint64_t mask = 0;
  for (int row = 0; row < area.rows; ++row) {
    const std::uint32_t* ids =
        image.block_id.data() +
        static_cast<std::size_t>(area.y + row) * static_cast<std::size_t>(image.width) +
        static_cast<std::size_t>(area.x);
    std::uint64_t row_mask = 0;
    for (int column = 0; column < area.columns; ++column) {
      row_mask |= std::uint64_t{ids[column] != image::kNoBlock} << column;
    }
    if (keep && row_mask != 0) {
      for (int column = 0; column < area.columns; ++column) {
        if ((row_mask >> column & 1) != 0 && !keep(area.x + column, area.y + row)) {
          row_mask &= ~(std::uint64_t{1} << column);
        }
      }
    }
    mask |= row_mask << (kTilePx * row);
  }
  return mask;
}

// Calls fn(row, pixel index in the image) for each set bit, in order.
template <typename Fn>
void ForEachPixel(std::uint64_t mask, const TileArea& area, int width, const Fn& fn) {
  for (int row = 0; row < kTilePx; ++row) {
    const std::size_t row_start =
        static_cast<std::size_t>(area.y + row) * static_cast<std::size_t>(width) +
        static_cast<std::size_t>(area.x);
    for (auto bits = static_cast<std::uint32_t>(mask >> (kTilePx * row) & 0xff); bits != 0;
         bits &= bits - 1) {
      fn(row, row_start + static_cast<std::size_t>(std::countr_zero(bits)));
    }
  }
}

void AddTile(const image::FrameImage& image, const TileArea& area, std::uint64_t mask,
             std::uint32_t* previous_id, Predecessor* predecessor, Band* band) {
  TileDictionary dictionary;
  const std::size_t first_index = band->indices.size();
  const std::size_t first_pixel = band->depths.size();
  const auto count = static_cast<std::size_t>(std::popcount(mask));
  band->indices.resize(first_index + count);
  band->depths.resize(first_pixel + count);
  for (auto& plane : band->colors) {
    plane.resize(first_pixel + count);
  }
  std::uint8_t* index = band->indices.data() + first_index;
  std::uint32_t* depth = band->depths.data() + first_pixel;
  std::uint8_t* c0 = band->colors[0].data() + first_pixel;
  std::uint8_t* c1 = band->colors[1].data() + first_pixel;
  std::uint8_t* c2 = band->colors[2].data() + first_pixel;
  predecessor->BeginTile();
  ForEachPixel(mask, area, image.width, [&](int row, std::size_t i) {
    const image::Rgba8 color = image.color[i];
    // + 0.0F turns -0 into +0, as FragmentKey does.
    const Pixel pixel{std::bit_cast<std::uint32_t>(image.depth[i] + 0.0F), color.r,
                      static_cast<std::uint8_t>(color.g - color.r),
                      static_cast<std::uint8_t>(color.b - color.g)};
    Pixel& before = predecessor->Of(row);
    *depth++ = ZigZag(pixel.depth_bits - before.depth_bits);
    *c0++ = static_cast<std::uint8_t>(pixel.r - before.r);
    *c1++ = static_cast<std::uint8_t>(pixel.g_minus_r - before.g_minus_r);
    *c2++ = static_cast<std::uint8_t>(pixel.b_minus_g - before.b_minus_g);
    before = pixel;
    predecessor->Stored();
    *index++ = dictionary.IndexOf(image.block_id[i]);
  });
  predecessor->EndTile();
  if (dictionary.size() == 1) {
    band->indices.resize(first_index);
  }
  band->dictionary_sizes.push_back(Low8(dictionary.size() - 1));
  for (std::uint32_t entry = 0; entry < dictionary.size(); ++entry) {
    band->dictionaries.push_back(ZigZag(dictionary.id(entry) - *previous_id));
    *previous_id = dictionary.id(entry);
  }
}

std::string Serialize(const Band& band, const image::FrameImage& image, int begin_tile_row,
                      int tile_row_count) {
  std::string payload;
  payload.reserve(band.masks.size() * 8 + band.dictionary_sizes.size() +
                  4 * band.dictionaries.size() + band.indices.size() + 7 * band.depths.size());
  AppendBytes(band.masks, &payload);
  AppendBytes(band.dictionary_sizes, &payload);
  AppendPlanes(band.dictionaries, &payload);
  AppendBytes(band.indices, &payload);
  AppendPlanes(band.depths, &payload);
  for (const auto& plane : band.colors) {
    AppendBytes(plane, &payload);
  }

  std::string bytes(kMagic, kMagicSize);
  base::AppendLittleEndian(std::uint32_t{0}, &bytes);
  base::AppendLittleEndian(kVersion, &bytes);
  base::AppendLittleEndian(std::uint8_t{0}, &bytes);
  base::AppendLittleEndian(std::uint16_t{0}, &bytes);
  base::AppendLittleEndian(static_cast<std::uint32_t>(image.width), &bytes);
  base::AppendLittleEndian(static_cast<std::uint32_t>(image.height), &bytes);
  base::AppendLittleEndian(static_cast<std::uint32_t>(begin_tile_row), &bytes);
  base::AppendLittleEndian(static_cast<std::uint32_t>(tile_row_count), &bytes);
  base::AppendLittleEndian(static_cast<std::uint32_t>(band.depths.size()), &bytes);
  base::AppendLittleEndian(static_cast<std::uint32_t>(band.dictionaries.size()), &bytes);
  base::AppendLittleEndian(static_cast<std::uint32_t>(band.indices.size()), &bytes);
  bytes += base::Compress(payload);
  base::StoreLittleEndian(
      base::ExtendCrc32c(0, bytes.data() + kChecksummedOffset, bytes.size() - kChecksummedOffset),
      bytes.data() + kMagicSize);
  return bytes;
}

int TileCount(int size_px) { return (size_px + kTilePx - 1) / kTilePx; }

// The header of a band that fits `image`, checked.
struct Header {
  std::uint32_t begin_tile_row = 0;
  std::uint32_t tile_row_count = 0;
  std::size_t tile_count = 0;
  std::size_t pixel_count = 0;
  std::size_t dictionary_count = 0;
  std::size_t index_count = 0;
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
  std::array<std::uint32_t, 7> fields{};
  bool complete = decoder.Read(&version) && decoder.Read(&flags) && decoder.Read(&reserved);
  for (std::uint32_t& field : fields) {
    complete = complete && decoder.Read(&field);
  }
  if (!complete || version != kVersion || flags != 0 || reserved != 0) {
    return absl::DataLossError(
        absl::StrFormat("pixel band: version %d, flags %d, reserved %d; expected %d, 0, 0", version,
                        flags, reserved, kVersion));
  }
  const auto [width, height, begin_row, row_count, pixels, entries, indices] = fields;
  if (width != static_cast<std::uint32_t>(image.width) ||
      height != static_cast<std::uint32_t>(image.height)) {
    return absl::DataLossError(
        absl::StrFormat("pixel band of an image of %d x %d pixels; expected %d x %d", width, height,
                        image.width, image.height));
  }
  const auto tile_columns = static_cast<std::uint32_t>(TileCount(image.width));
  const auto tile_rows = static_cast<std::uint32_t>(TileCount(image.height));
  if (row_count < 1 || begin_row >= tile_rows || row_count > tile_rows - begin_row) {
    return absl::DataLossError(absl::StrFormat(
        "pixel band of tile rows [%d, +%d): the image has %d", begin_row, row_count, tile_rows));
  }
  Header header;
  header.begin_tile_row = begin_row;
  header.tile_row_count = row_count;
  header.tile_count = std::size_t{tile_columns} * row_count;
  header.pixel_count = pixels;
  header.dictionary_count = entries;
  header.index_count = indices;
  if (pixels < 1 || header.pixel_count > header.tile_count * kTilePixels || entries > pixels ||
      indices > pixels) {
    return absl::DataLossError(
        absl::StrFormat("pixel band of %d tiles: %d pixels, %d dictionary entries, %d indices",
                        header.tile_count, pixels, entries, indices));
  }
  return header;
}

// Joins 4 planes of `count` bytes.
std::vector<std::uint32_t> JoinPlanes(absl::string_view planes, std::size_t count) {
  std::vector<std::uint32_t> values(count);
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(planes.data());
  for (std::size_t i = 0; i < count; ++i) {
    values[i] = std::uint32_t{bytes[i]} | std::uint32_t{bytes[i + count]} << 8 |
                std::uint32_t{bytes[i + 2 * count]} << 16 |
                std::uint32_t{bytes[i + 3 * count]} << 24;
  }
  return values;
}

absl::Status Damaged(absl::string_view what) {
  return absl::DataLossError(absl::StrFormat("pixel band: %s", what));
}

// The sections of a payload, and what they say once the differences are undone.
struct Payload {
  std::vector<std::uint64_t> masks;
  absl::string_view dictionary_sizes;
  std::vector<std::uint32_t> dictionaries;  // block ids
  absl::string_view indices;
  std::vector<std::uint32_t> depths;  // bits
  absl::string_view colors;           // differences
};

// Everything is checked here, so that compositing can't fail half-way.
absl::StatusOr<Payload> ReadPayload(absl::string_view bytes, const Header& header,
                                    const image::FrameImage& image) {
  base::Decoder decoder(bytes);
  Payload payload;
  payload.masks.resize(header.tile_count);
  absl::string_view section;
  if (!decoder.ReadBytes(8 * header.tile_count, &section)) {
    return Damaged("the coverage masks are incomplete");
  }
  std::copy(section.begin(), section.end(), reinterpret_cast<char*>(payload.masks.data()));

  const int tile_columns = TileCount(image.width);
  std::size_t covered_tiles = 0;
  std::size_t pixel_count = 0;
  for (std::size_t tile = 0; tile < header.tile_count; ++tile) {
    const std::uint64_t mask = payload.masks[tile];
    if (mask == 0) {
      continue;
    }
    ++covered_tiles;
    pixel_count += static_cast<std::size_t>(std::popcount(mask));
    const int tile_x = static_cast<int>(tile) % tile_columns;
    const int tile_y =
        static_cast<int>(header.begin_tile_row) + static_cast<int>(tile) / tile_columns;
    const TileArea area = AreaOf(tile_x, tile_y, image.width, image.height);
    const std::uint64_t row_mask = (std::uint64_t{1} << area.columns) - 1;
    std::uint64_t inside = 0;
    for (int row = 0; row < area.rows; ++row) {
      inside |= row_mask << (kTilePx * row);
    }
    if ((mask & ~inside) != 0) {
      return Damaged("a coverage mask reaches outside the image");
    }
  }
  if (pixel_count != header.pixel_count) {
    return Damaged("the coverage masks do not have as many pixels as the header states");
  }

  if (!decoder.ReadBytes(covered_tiles, &payload.dictionary_sizes)) {
    return Damaged("the dictionary sizes are incomplete");
  }
  absl::string_view dictionary_planes;
  absl::string_view depth_planes;
  if (!decoder.ReadBytes(4 * header.dictionary_count, &dictionary_planes) ||
      !decoder.ReadBytes(header.index_count, &payload.indices) ||
      !decoder.ReadBytes(4 * header.pixel_count, &depth_planes) ||
      !decoder.ReadBytes(3 * header.pixel_count, &payload.colors) || decoder.remaining() != 0) {
    return Damaged("the payload does not have the size that its header states");
  }

  payload.dictionaries = JoinPlanes(dictionary_planes, header.dictionary_count);
  std::uint32_t previous_id = 0;
  for (std::uint32_t& entry : payload.dictionaries) {
    entry = previous_id += UnZigZag(entry);
    if (entry == image::kNoBlock) {
      return Damaged("a covered pixel belongs to no block");
    }
  }

  payload.depths = JoinPlanes(depth_planes, header.pixel_count);
  Predecessor predecessor;
  std::uint32_t* depth = payload.depths.data();
  std::uint32_t largest = 0;
  std::size_t entry_count = 0;
  std::size_t index_count = 0;
  const char* size_code = payload.dictionary_sizes.data();
  for (const std::uint64_t mask : payload.masks) {
    if (mask == 0) {
      continue;
    }
    const auto pixels = static_cast<std::size_t>(std::popcount(mask));
    const std::size_t entries = std::size_t{static_cast<std::uint8_t>(*size_code++)} + 1;
    entry_count += entries;
    if (entries > 1) {
      if (index_count + pixels > payload.indices.size()) {
        return Damaged("the indices are incomplete");
      }
      for (const char index : payload.indices.substr(index_count, pixels)) {
        if (static_cast<std::uint8_t>(index) >= entries) {
          return Damaged("an index points outside its dictionary");
        }
      }
      index_count += pixels;
    }
    predecessor.BeginTile();
    ForEachPixel(mask, TileArea{}, 0, [&](int row, std::size_t) {
      Pixel& before = predecessor.Of(row);
      before.depth_bits += UnZigZag(*depth);
      *depth++ = before.depth_bits;
      largest = std::max(largest, before.depth_bits);
      predecessor.Stored();
    });
    predecessor.EndTile();
  }
  if (entry_count != header.dictionary_count || index_count != header.index_count) {
    return Damaged("the dictionaries do not have as many entries as the header states");
  }
  if (largest > kOneBits) {
    return Damaged("a depth is not in [0, 1]");
  }
  return payload;
}

void CompositePayload(const Payload& payload, const Header& header, image::FrameImage* into) {
  const int tile_columns = TileCount(into->width);
  const std::uint32_t* dictionary = payload.dictionaries.data();
  const char* size_code = payload.dictionary_sizes.data();
  const char* index = payload.indices.data();
  const std::uint32_t* depth = payload.depths.data();
  const auto* c0 = reinterpret_cast<const std::uint8_t*>(payload.colors.data());
  const std::uint8_t* c1 = c0 + header.pixel_count;
  const std::uint8_t* c2 = c1 + header.pixel_count;
  Predecessor predecessor;
  for (std::size_t tile = 0; tile < payload.masks.size(); ++tile) {
    const std::uint64_t mask = payload.masks[tile];
    if (mask == 0) {
      continue;
    }
    const int tile_y =
        static_cast<int>(header.begin_tile_row) + static_cast<int>(tile) / tile_columns;
    const TileArea area =
        AreaOf(static_cast<int>(tile) % tile_columns, tile_y, into->width, into->height);
    const std::size_t entries = std::size_t{static_cast<std::uint8_t>(*size_code++)} + 1;
    predecessor.BeginTile();
    ForEachPixel(mask, area, into->width, [&](int row, std::size_t i) {
      Pixel& before = predecessor.Of(row);
      before.r = static_cast<std::uint8_t>(before.r + *c0++);
      before.g_minus_r = static_cast<std::uint8_t>(before.g_minus_r + *c1++);
      before.b_minus_g = static_cast<std::uint8_t>(before.b_minus_g + *c2++);
      predecessor.Stored();
      const float fragment_depth = std::bit_cast<float>(*depth++);
      const std::uint32_t id =
          entries == 1 ? *dictionary : dictionary[static_cast<std::uint8_t>(*index++)];
      if (image::FragmentKey(fragment_depth, id) <
          image::FragmentKey(into->depth[i], into->block_id[i])) {
        into->depth[i] = fragment_depth;
        into->block_id[i] = id;
        const auto g = static_cast<std::uint8_t>(before.r + before.g_minus_r);
        into->color[i] = {before.r, g, static_cast<std::uint8_t>(g + before.b_minus_g), 255};
      }
    });
    predecessor.EndTile();
    dictionary += entries;
  }
}

}  // namespace

std::vector<std::string> EncodePixels(const image::FrameImage& image,
                                      const std::function<bool(int x, int y)>& keep) {
  const int tile_columns = TileCount(image.width);
  const int tile_rows = TileCount(image.height);
  std::vector<std::string> bands;
  if (tile_columns == 0 || tile_rows == 0) {
    return bands;
  }
  const auto rows_per_band =
      static_cast<int>(std::max<std::int64_t>(1, kMaxBandBytes / (kMaxTileBytes * tile_columns)));
  Band band;
  for (int begin_row = 0; begin_row < tile_rows; begin_row += rows_per_band) {
    const int end_row = std::min(tile_rows, begin_row + rows_per_band);
    band.Clear();
    Predecessor predecessor;
    std::uint32_t previous_id = 0;
    for (int tile_y = begin_row; tile_y < end_row; ++tile_y) {
      for (int tile_x = 0; tile_x < tile_columns; ++tile_x) {
        const TileArea area = AreaOf(tile_x, tile_y, image.width, image.height);
        const std::uint64_t mask = CoverageMask(image, area, keep);
        band.masks.push_back(mask);
        if (mask != 0) {
          AddTile(image, area, mask, &previous_id, &predecessor, &band);
        }
      }
    }
    if (!band.depths.empty()) {
      bands.push_back(Serialize(band, image, begin_row, end_row - begin_row));
    }
  }
  return bands;
}

absl::Status DecodePixelsInto(absl::string_view band, image::FrameImage* into) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Header header, ReadHeader(band, *into));
  const std::size_t payload_size_limit =
      header.tile_count * static_cast<std::size_t>(kMaxTileBytes);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes,
                            base::Decompress(band.substr(kHeaderSize), payload_size_limit));
  ISOSCOPE_ASSIGN_OR_RETURN(const Payload payload, ReadPayload(bytes, header, *into));
  CompositePayload(payload, header, into);
  return absl::OkStatus();
}

}  // namespace isoscope::composite
