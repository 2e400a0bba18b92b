// Encodes a band in three steps. docs/format/wire.md, "Pixel band", has the layout.
//
// 1. FindColors collects the colours of the band. Up to 2048 of them become a sorted palette, and a
//    pixel's colour is an index into it. A band with more sends each colour as it is.
// 2. EncodePixels goes tile by tile over the covered pixels. It packs depths, owners and colours
//    into dense lists, and subtracts the value predicted from the neighbours (TilePrediction). It
//    codes each difference as one of 16 classes and some extra bits (number_code.h). Owners become
//    a dictionary of the tile, and a label for each pixel if the tile has several.
// 3. Serialize compresses coverage, dictionaries, labels and palette with Zstandard. Control bytes
//    and extra bits follow as they are.
//
// Example: left of a pixel, L and LL are covered, and no pixel above is. With the depth bits 100 in
// L and 90 in LL, the prediction is 110. The pixel has 108. The difference -2 is ZigZag(-2) = 3, in
// class 2, which begins at 3 and has 3 extra bits, here 000. Its colour is that of L: class 0
// without extra bits. So the pixel costs the control byte 0x02 and 3 bits.
//
// A difference is modulo 2^32, so the decoder gets exactly the same depth bits and colours.

#include "core/composite/band_encoder.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <memory>
#include <utility>

#include "core/base/compression.h"
#include "core/base/large_pages.h"
#include "core/composite/number_code.h"
#include "core/composite/tile_packing.h"

namespace isoscope::composite {
namespace {

// The colours of a band, in a hash table of slots, and their indices once they are sorted.
class Palette {
 public:
  static constexpr std::uint16_t kNone = 0xffff;

  // Returns the slot of a colour, and adds the colour if it is new. kNone if there are too many.
  std::uint16_t SlotOf(std::uint32_t number) {
    // Fibonacci hashing: shades of one material and codes of normals spread alike.
    std::size_t at = number * 0x9e3779b1U >> 20;
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

  // Returns the colours in ascending order. From then on IndexOf is valid, and SlotOf is not.
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

  // Returns the index of a slot's colour among the sorted ones. REQUIRES: Sort was called.
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
  // Returns the end of the written bytes.
  [[nodiscard]] char* Finish() { return out_ + (pending_count_ != 0 ? 1 : 0); }

 private:
  char* out_;
  std::uint64_t pending_ = 0;
  unsigned pending_count_ = 0;
};

// The owners of one tile, in the order of their first pixels.
class TileDictionary {
 public:
  // Returns the index of `id`, and adds it if it is new.
  std::uint8_t IndexOf(std::uint32_t id) {
    if (size_ == 0 || ids_[last_] != id) {
      // Along an edge, two blocks alternate.
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
  std::size_t last_ = 0;    // the index of the pixel before
  std::size_t before_ = 0;  // a different index, of an earlier pixel
};

template <typename T>
void AppendBytes(const std::vector<T>& values, std::string* out) {
  out->append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
}

class BandEncoder {
 public:
  BandEncoder(const image::FrameImage& image, BandRows rows, std::span<const TileRow> tiles,
              bool is_layer)
      : image_(image), rows_(rows), is_layer_(is_layer) {
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
                                                     kBandPaddingBytes);
    if (!palette_numbers_.empty()) {
      EncodePixels<true>();
    } else {
      EncodePixels<false>();
    }
    return Serialize();
  }

 private:
  // Step 1. Finds the palette, and the slot of each covered pixel in it.
  void FindColors() {
    slots_ = std::make_unique_for_overwrite<std::uint16_t[]>(pixel_count_);
    std::uint16_t* out = slots_.get();
    std::array<std::uint32_t, kTilePixels + kPackPadding> numbers;
    for (std::size_t tile = 0; tile < areas_.size(); ++tile) {
      if (const std::size_t later = tile + kPrefetchTiles; later < areas_.size()) {
        PrefetchRows(image_.colors, areas_[later], side_.masks[later], image_.width);
      }
      const TileMask& mask = side_.masks[tile];
      PackColors(mask, FirstOf(image_.colors, areas_[tile]), Stride(), numbers.data());
      for (const std::uint32_t number : std::span(numbers).first(PixelCount(mask))) {
        const std::uint16_t slot = palette_.SlotOf(number);
        if (slot == Palette::kNone) {
          return;
        }
        *out++ = slot;
      }
    }
    palette_numbers_ = palette_.Sort();
  }

  // Step 2. Writes control bytes and extra bits.
  template <bool kHasPalette>
  void EncodePixels() {
    std::uint8_t* control = controls_.get();
    const std::uint16_t* slot = slots_.get();
    BitWriter extras(extras_.get());
    TilePrediction prediction;
    static_assert(kClassifyPadding >= kPackPadding);
    TileNumbers numbers{};
    TileNumbers differences{};
    std::array<std::uint32_t, kTilePixels + kPackPadding> ids;
    for (std::size_t tile = 0; tile < areas_.size(); ++tile) {
      if (const std::size_t later = tile + kPrefetchTiles; later < areas_.size()) {
        PrefetchRows(image_.keys, areas_[later], side_.masks[later], image_.width);
        if (!kHasPalette) {
          PrefetchRows(image_.colors, areas_[later], side_.masks[later], image_.width);
        }
      }
      // Pack the covered pixels of the tile.
      const TileMask& mask = side_.masks[tile];
      const std::size_t count = PixelCount(mask);
      PackKeys(mask, FirstOf(image_.keys, areas_[tile]), Stride(), numbers.depths.data(),
               ids.data());
      if (kHasPalette) {
        for (std::size_t i = 0; i < count; ++i) {
          numbers.colors[i] = palette_.IndexOf(slot[i]);
        }
        slot += count;
      } else {
        PackColors(mask, FirstOf(image_.colors, areas_[tile]), Stride(), numbers.colors.data());
      }
      AddLabels(std::span(ids).first(count));
      // Code their differences from the prediction.
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
    std::memset(extras_.get() + extras_size_, 0, kBandPaddingBytes);
    extras_size_ += kBandPaddingBytes;
  }

  // Adds a tile's dictionary, and the labels of its covered pixels if it has several owners.
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

  // Step 3.
  std::string Serialize() {
    const std::size_t dictionary_count = side_.dictionaries.size();
    std::string side;
    side.reserve(8 * side_.present.size() + sizeof(TileMask) * areas_.size() + areas_.size() +
                 4 * dictionary_count + side_.labels.size() + 4 * palette_numbers_.size());
    AppendBytes(side_.present, &side);
    AppendBytes(side_.masks, &side);
    AppendBytes(side_.dictionary_sizes, &side);
    AppendNumbers(side_.dictionaries, &side);
    AppendBytes(side_.labels, &side);
    AppendNumbers(palette_numbers_, &side);
    const std::string frame = base::Compress(side);

    std::string bytes = MakeBandHeader({.is_layer = is_layer_,
                                        .begin_row = rows_.begin,
                                        .row_count = rows_.end - rows_.begin,
                                        .pixel_count = pixel_count_,
                                        .tile_count = areas_.size(),
                                        .dictionary_count = dictionary_count,
                                        .label_count = side_.labels.size(),
                                        .palette_size = palette_numbers_.size(),
                                        .frame_size = frame.size(),
                                        .extras_size = extras_size_},
                                       image_.width, image_.height);
    bytes.reserve(kBandHeaderSize + frame.size() + pixel_count_ + extras_size_);
    bytes += frame;
    bytes.append(reinterpret_cast<const char*>(controls_.get()), pixel_count_);
    bytes.append(extras_.get(), extras_size_);
    SealBand(&bytes);
    return bytes;
  }

  template <typename T>
  [[nodiscard]] const T* FirstOf(const base::LargePageVector<T>& plane,
                                 const TileArea& area) const {
    return plane.data() + image_.IndexOf(area.x, area.y);
  }
  [[nodiscard]] std::size_t Stride() const { return static_cast<std::size_t>(image_.width); }

  const image::FrameImage& image_;
  const BandRows rows_;
  const bool is_layer_;
  BandSideInfo side_;
  std::vector<TileArea> areas_;  // of tiles with a covered pixel
  std::size_t pixel_count_ = 0;
  Palette palette_;
  std::vector<std::uint32_t> palette_numbers_;  // empty: colours are sent as they are
  std::unique_ptr<std::uint16_t[]> slots_;
  std::unique_ptr<std::uint8_t[]> controls_;
  std::unique_ptr<char[]> extras_;
  std::size_t extras_size_ = 0;
};

}  // namespace

std::string EncodeBand(const image::FrameImage& image, BandRows rows,
                       std::span<const TileRow> tiles, bool is_layer) {
  return BandEncoder(image, rows, tiles, is_layer).Encode();
}

}  // namespace isoscope::composite
