// Decodes a band: the steps of band_encoder.cc backwards. The bytes may be damaged or hostile, so
// nothing is trusted before it is checked:
//
// 1. ReadBandHeader compares the checksum, and checks that the sizes in the header add up to the
//    size of the band and that its counts are possible. So later steps allocate in proportion to
//    the band and the image.
// 2. ReadSideInfo decompresses the side information, which must have the size that follows from the
//    counts.
// 3. CheckTiles checks the parts against each other: no pixel outside the image, no tile without a
//    pixel, no label outside its dictionary, no owner beyond the frame's surfaces and blocks, and
//    as many extra bits as the control bytes ask for. The 8 bytes of padding then allow reading 8
//    bytes at any bit.
// 4. DecodePixels undoes the prediction, tile by tile. At the end it checks the results: depths
//    must lie in [0, 1], colours in the palette. The bits of 1.0 bound all valid depths: -0 and NaN
//    have larger bits.
//
// The pixels go into vectors of their own. The caller's image changes only after all of this.

#include "core/composite/band_decoder.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/coding.h"
#include "core/base/compression.h"
#include "core/base/status_macros.h"
#include "core/composite/number_code.h"

namespace isoscope::composite {
namespace {

constexpr std::uint32_t kOneBits = std::bit_cast<std::uint32_t>(1.0F);

absl::Status Damaged(absl::string_view what) {
  return absl::DataLossError(absl::StrFormat("pixel band: %s", what));
}

class BandDecoder {
 public:
  // Owners must be below `owner_count`.
  BandDecoder(absl::string_view band, const BandHeader& header, const image::FrameImage& image,
              std::uint64_t owner_count)
      : header_(header),
        image_(image),
        owner_count_(owner_count),
        frame_(band.substr(kBandHeaderSize, header.frame_size)),
        controls_(reinterpret_cast<const std::uint8_t*>(frame_.data()) + frame_.size()),
        extras_(reinterpret_cast<const char*>(controls_) + header.pixel_count) {
    pixels_.keys = std::make_unique_for_overwrite<std::uint64_t[]>(header.pixel_count);
    pixels_.colors = std::make_unique_for_overwrite<image::Rgba8[]>(header.pixel_count);
  }

  absl::StatusOr<BandPixels> Decode() {
    ISOSCOPE_RETURN_IF_ERROR(ReadSideInfo());
    ISOSCOPE_RETURN_IF_ERROR(CheckTiles());
    ISOSCOPE_RETURN_IF_ERROR(header_.palette_size != 0 ? DecodePixels<true>()
                                                       : DecodePixels<false>());
    pixels_.masks = std::move(side_.masks);
    return std::move(pixels_);
  }

 private:
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
    const auto read_numbers = [&at](std::size_t count) {
      return ReadNumbers({std::exchange(at, at + 4 * count), 4 * count}, count);
    };
    read(present_count, &side_.present);
    read(header_.tile_count, &side_.masks);
    read(header_.tile_count, &side_.dictionary_sizes);
    side_.dictionaries = read_numbers(header_.dictionary_count);
    read(header_.label_count, &side_.labels);
    for (const std::uint32_t number : read_numbers(header_.palette_size)) {
      palette_.push_back(ColorOf(number));
    }
    return absl::OkStatus();
  }

  // Finds the areas of the tiles, and checks coverage, dictionaries, labels and extra bits.
  absl::Status CheckTiles() {
    const int columns = image_.touched.columns();
    const std::size_t row_words = RowWords(image_.touched);
    pixels_.areas.reserve(header_.tile_count);
    for (std::size_t word = 0; word < side_.present.size(); ++word) {
      const int tile_y = header_.begin_row + static_cast<int>(word / row_words);
      for (std::uint64_t rest = side_.present[word]; rest != 0; rest &= rest - 1) {
        const int tile_x = 64 * static_cast<int>(word % row_words) + std::countr_zero(rest);
        if (tile_x >= columns || pixels_.areas.size() == header_.tile_count) {
          return Damaged("there are other tiles than the header states");
        }
        pixels_.areas.push_back(AreaOf(tile_x, tile_y, image_));
      }
    }
    if (pixels_.areas.size() != header_.tile_count) {
      return Damaged("there are fewer tiles than the header states");
    }
    return CheckContents();
  }

  // The masks, dictionaries and labels of the tiles, and how many extra bits they ask for.
  absl::Status CheckContents() const {
    std::size_t pixel_count = 0;
    std::size_t entry_count = 0;
    std::size_t label_count = 0;
    for (std::size_t tile = 0; tile < pixels_.areas.size(); ++tile) {
      const TileMask& mask = side_.masks[tile];
      const std::uint32_t inside = (1U << pixels_.areas[tile].columns) - 1;
      for (int row = 0; row < kTilePx; ++row) {
        if ((mask[static_cast<std::size_t>(row)] &
             ~(row < pixels_.areas[tile].rows ? inside : 0)) != 0) {
          return Damaged("the coverage of a tile reaches outside the image");
        }
      }
      const std::size_t pixels = PixelCount(mask);
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
    for (const std::uint32_t owner : side_.dictionaries) {
      if (owner == image::kNoOwner) {
        return Damaged("a covered pixel has no owner");
      }
      if (owner >= owner_count_) {
        return Damaged(absl::StrCat("a covered pixel has owner ", owner,
                                    ", which must be less than the frame's ", owner_count_));
      }
    }
    // The padding keeps reads of 8 bytes, from the byte of any bit on, inside the band.
    std::size_t bit_count = 0;
    for (std::size_t i = 0; i < header_.pixel_count; ++i) {
      bit_count += kControls[controls_[i]].all_bits;
    }
    if ((bit_count + 7) / 8 + kBandPaddingBytes != header_.extras_size) {
      return Damaged("there are not as many extra bits as the control bytes say");
    }
    return absl::OkStatus();
  }

  template <bool kHasPalette>
  absl::Status DecodePixels() {
    const std::uint8_t* control = controls_;
    std::uint64_t* key = pixels_.keys.get();
    image::Rgba8* color = pixels_.colors.get();
    const std::uint8_t* label = side_.labels.data();
    const std::uint32_t* dictionary = side_.dictionaries.data();
    std::size_t bit = 0;
    std::uint32_t largest_depth = 0;
    std::uint32_t largest_color = 0;
    const auto palette_size = static_cast<std::uint32_t>(palette_.size());
    TilePrediction prediction;
    TileNumbers differences;
    TileNumbers numbers;
    for (std::size_t tile = 0; tile < pixels_.areas.size(); ++tile) {
      const TileMask& mask = side_.masks[tile];
      const std::size_t count = PixelCount(mask);
      for (std::size_t i = 0; i < count; ++i) {
        const Control& code = kControls[control[i]];
        const unsigned color_bits = code.all_bits - code.depth_bits;
        const std::uint64_t depth_extra = BitsFrom(bit);
        // 57 bits are enough for both, unless colours are sent as they are.
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

  // Returns at least 57 extra bits, from `bit` on.
  [[nodiscard]] std::uint64_t BitsFrom(std::size_t bit) const {
    return base::LoadLittleEndian<std::uint64_t>(extras_ + bit / 8) >> (bit % 8);
  }
  static std::uint32_t LowBits(std::uint64_t bits, unsigned count) {
    return static_cast<std::uint32_t>(bits & ((std::uint64_t{1} << count) - 1));
  }

  const BandHeader& header_;
  const image::FrameImage& image_;
  const std::uint64_t owner_count_;
  const absl::string_view frame_;
  const std::uint8_t* const controls_;
  const char* const extras_;
  BandSideInfo side_;
  std::vector<image::Rgba8> palette_;
  BandPixels pixels_;
};

}  // namespace

absl::StatusOr<BandPixels> DecodeBand(absl::string_view band, const image::FrameImage& image,
                                      const image::FragmentOrder& order,
                                      const SurfaceCounts& surfaces) {
  ISOSCOPE_ASSIGN_OR_RETURN(const BandHeader header, ReadBandHeader(band, image));
  const std::uint64_t owner_count =
      std::uint64_t{order.block_count} * (header.is_layer ? surfaces.layers : surfaces.opaque);
  ISOSCOPE_ASSIGN_OR_RETURN(BandPixels pixels,
                            BandDecoder(band, header, image, owner_count).Decode());
  pixels.is_layer = header.is_layer;
  return pixels;
}

}  // namespace isoscope::composite
