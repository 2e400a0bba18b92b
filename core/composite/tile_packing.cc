// Pixels are taken row by row, each row from left to right, which is the order of the set bits of
// the mask. With AVX-512 a row of 16 pixels is one register of colours and two of keys, and the
// row's mask is a lane mask: compressing packs it, expanding unpacks it. Elsewhere the bits are
// taken one by one. Both give the same bits.
//
// Example: the row mask 0b10110 packs the pixels of columns 1, 2 and 4 into elements 0, 1 and 2.
//
// A key is depth << 32 | block id, so that the smaller key is nearer, or of the lower block.

#include "core/composite/tile_packing.h"

#include <bit>

#include "core/composite/band_format.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/composite/tile_packing.cc"
#include "hwy/foreach_target.h"  // IWYU pragma: keep
//
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::composite {
namespace HWY_NAMESPACE {
namespace {

#if HWY_TARGET <= HWY_AVX3 && HWY_ARCH_X86

// Loads a row of keys as two registers. Gathers the low and the high halves of its words (block ids
// and depths), and compresses each to the covered pixels.
void PackKeys(const TileMask& mask, const std::uint64_t* keys, std::size_t stride,
              std::uint32_t* depths, std::uint32_t* owners) {
  static_assert(kTilePx == 16);
  const __m512i even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
  const __m512i odd = _mm512_add_epi32(even, _mm512_set1_epi32(1));
  for (const std::uint32_t row_mask : mask) {
    if (row_mask != 0) {
      const __m512i left = _mm512_maskz_loadu_epi64(static_cast<__mmask8>(row_mask), keys);
      const __m512i right =
          _mm512_maskz_loadu_epi64(static_cast<__mmask8>(row_mask >> 8), keys + 8);
      const auto pack = [&](__m512i half) {
        return _mm512_maskz_compress_epi32(static_cast<__mmask16>(row_mask),
                                           _mm512_permutex2var_epi32(left, half, right));
      };
      _mm512_storeu_si512(owners, pack(even));
      _mm512_storeu_si512(depths, pack(odd));
      const int count = std::popcount(row_mask);
      owners += count;
      depths += count;
    }
    keys += stride;
  }
}

// Reverses the bytes of each colour, r first in memory, to r << 24 | g << 16 | b << 8 | a.
void PackColors(const TileMask& mask, const image::Rgba8* colors, std::size_t stride,
                std::uint32_t* numbers) {
  static_assert(kTilePx == 16);
  const __m512i reversed = _mm512_set4_epi32(0x0c0d0e0f, 0x08090a0b, 0x04050607, 0x00010203);
  for (const std::uint32_t row_mask : mask) {
    if (row_mask != 0) {
      const auto lanes = static_cast<__mmask16>(row_mask);
      const __m512i row = _mm512_maskz_loadu_epi32(lanes, colors);
      _mm512_storeu_si512(numbers,
                          _mm512_maskz_compress_epi32(lanes, _mm512_shuffle_epi8(row, reversed)));
      numbers += std::popcount(row_mask);
    }
    colors += stride;
  }
}

// Expands the keys of half a row to its covered lanes, compares their depths with the tile's, and
// stores keys and colours of the lanes that are nearer. Returns whether a lane has a tie in depth.
bool UnpackNearer(const TileMask& mask, const std::uint64_t* keys, const image::Rgba8* colors,
                  std::size_t stride, std::uint64_t* into_keys, image::Rgba8* into_colors) {
  std::uint32_t ties = 0;
  for (const std::uint32_t row_mask : mask) {
    if (row_mask != 0) {
      const auto unpack_half = [&](std::uint32_t half, std::uint64_t* into) {
        const auto lanes = static_cast<__mmask8>(half);
        const __m512i key = _mm512_maskz_expandloadu_epi64(lanes, keys);
        const __m512i old_key = _mm512_maskz_loadu_epi64(lanes, into);
        const __m512i depth = _mm512_srli_epi64(key, 32);
        const __m512i old_depth = _mm512_srli_epi64(old_key, 32);
        const __mmask8 nearer = _mm512_mask_cmplt_epu64_mask(lanes, depth, old_depth);
        ties |= _mm512_mask_cmpeq_epu64_mask(lanes, depth, old_depth);
        _mm512_mask_storeu_epi64(into, nearer, key);
        keys += std::popcount(half);
        return static_cast<std::uint32_t>(nearer);
      };
      std::uint32_t nearer = unpack_half(row_mask & 0xff, into_keys);
      nearer |= unpack_half(row_mask >> 8, into_keys + 8) << 8;
      _mm512_mask_storeu_epi32(
          into_colors, static_cast<__mmask16>(nearer),
          _mm512_maskz_expandloadu_epi32(static_cast<__mmask16>(row_mask), colors));
      colors += std::popcount(row_mask);
    }
    into_keys += stride;
    into_colors += stride;
  }
  return ties != 0;
}

#else

void PackKeys(const TileMask& mask, const std::uint64_t* keys, std::size_t stride,
              std::uint32_t* depths, std::uint32_t* owners) {
  for (const std::uint32_t row_mask : mask) {
    for (std::uint32_t rest = row_mask; rest != 0; rest &= rest - 1) {
      const std::uint64_t key = keys[std::countr_zero(rest)];
      *depths++ = static_cast<std::uint32_t>(key >> 32);
      *owners++ = image::OwnerOf(key);
    }
    keys += stride;
  }
}

void PackColors(const TileMask& mask, const image::Rgba8* colors, std::size_t stride,
                std::uint32_t* numbers) {
  for (const std::uint32_t row_mask : mask) {
    for (std::uint32_t rest = row_mask; rest != 0; rest &= rest - 1) {
      *numbers++ = image::PackedColor(colors[std::countr_zero(rest)]);
    }
    colors += stride;
  }
}

bool UnpackNearer(const TileMask& mask, const std::uint64_t* keys, const image::Rgba8* colors,
                  std::size_t stride, std::uint64_t* into_keys, image::Rgba8* into_colors) {
  bool has_ties = false;
  for (const std::uint32_t row_mask : mask) {
    for (std::uint32_t rest = row_mask; rest != 0; rest &= rest - 1, ++keys, ++colors) {
      const int column = std::countr_zero(rest);
      if (image::HaveEqualDepth(*keys, into_keys[column])) {
        has_ties = true;
      } else if (*keys < into_keys[column]) {
        into_keys[column] = *keys;
        into_colors[column] = *colors;
      }
    }
    into_keys += stride;
    into_colors += stride;
  }
  return has_ties;
}

#endif

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace isoscope::composite
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace isoscope::composite {
namespace {
HWY_EXPORT(PackKeys);
HWY_EXPORT(PackColors);
HWY_EXPORT(UnpackNearer);
}  // namespace

void PackKeys(const TileMask& mask, const std::uint64_t* keys, std::size_t stride,
              std::uint32_t* depths, std::uint32_t* owners) {
  HWY_DYNAMIC_DISPATCH(PackKeys)(mask, keys, stride, depths, owners);
}

void PackColors(const TileMask& mask, const image::Rgba8* colors, std::size_t stride,
                std::uint32_t* numbers) {
  HWY_DYNAMIC_DISPATCH(PackColors)(mask, colors, stride, numbers);
}

bool UnpackNearer(const TileMask& mask, const std::uint64_t* keys, const image::Rgba8* colors,
                  std::size_t stride, std::uint64_t* into_keys, image::Rgba8* into_colors) {
  return HWY_DYNAMIC_DISPATCH(UnpackNearer)(mask, keys, colors, stride, into_keys, into_colors);
}

void SettleTies(const TileMask& mask, const std::uint64_t* keys, const image::Rgba8* colors,
                std::size_t stride, const image::FragmentOrder& order, std::uint64_t* into_keys,
                image::Rgba8* into_colors) {
  for (const std::uint32_t row_mask : mask) {
    for (std::uint32_t rest = row_mask; rest != 0; rest &= rest - 1, ++keys, ++colors) {
      const int column = std::countr_zero(rest);
      order.KeepFirst(*keys, *colors, into_keys + column, into_colors + column);
    }
    into_keys += stride;
    into_colors += stride;
  }
}

}  // namespace isoscope::composite

#endif  // HWY_ONCE
