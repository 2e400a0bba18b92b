// The encoder's side of the prediction, where all pixels are known: with AVX-512 a row of a tile is
// one register, its covered pixels are a lane mask, and every rule is a masked move. Elsewhere
// WalkTile takes pixels one by one. So it does in the decoder, which must know a pixel before it
// predicts the next. Fully covered tiles go through loops without masks.
//
// Rules and example: tile_prediction.h. Format: docs/format/wire.md, "Pixel band".

#include "core/composite/tile_prediction.h"

#include <bit>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/composite/tile_prediction.cc"
#include "hwy/foreach_target.h"  // IWYU pragma: keep
//
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::composite {
namespace HWY_NAMESPACE {
namespace {

#if HWY_TARGET <= HWY_AVX3 && HWY_ARCH_X86

// Predicts and subtracts depths or colours, a row of the tile in a register. The rules of WalkTile
// are applied from the weakest to the strongest: each overwrites the lanes in which it holds.
template <bool kIsDepth>
void SubtractRows(const TileMask& mask, const std::uint32_t* numbers, std::uint32_t last,
                  std::uint32_t* differences) {
  static_assert(kTilePx == 16);
  const __m512i zero = _mm512_setzero_si512();
  __m512i above = zero;
  __m512i above_2 = zero;
  std::uint32_t above_mask = 0;
  std::uint32_t above_2_mask = 0;
  const auto lanes = [](std::uint32_t bits) { return static_cast<__mmask16>(bits); };
  const auto go_on = [](__m512i one, __m512i two) {
    return _mm512_sub_epi32(_mm512_add_epi32(one, one), two);
  };
  for (const std::uint32_t here : mask) {
    if (here != 0) {
      const __m512i packed = _mm512_loadu_si512(numbers);
      const __m512i before =
          _mm512_alignr_epi32(packed, _mm512_set1_epi32(static_cast<int>(last)), 15);
      const __m512i row = _mm512_maskz_expand_epi32(lanes(here), packed);
      const __m512i left = _mm512_alignr_epi32(row, zero, 15);
      const std::uint32_t left_mask = here << 1;
      __m512i expected = _mm512_maskz_expand_epi32(lanes(here), before);
      expected = _mm512_mask_mov_epi32(expected, lanes(above_mask), above);
      if (kIsDepth) {
        expected = _mm512_mask_mov_epi32(expected, lanes(above_mask & above_2_mask),
                                         go_on(above, above_2));
      }
      expected = _mm512_mask_mov_epi32(expected, lanes(left_mask), left);
      if (kIsDepth) {
        expected = _mm512_mask_mov_epi32(expected, lanes(left_mask & left_mask << 1),
                                         go_on(left, _mm512_alignr_epi32(row, zero, 14)));
      }
      expected = _mm512_mask_mov_epi32(
          expected, lanes(left_mask & above_mask & above_mask << 1),
          _mm512_sub_epi32(_mm512_add_epi32(left, above), _mm512_alignr_epi32(above, zero, 15)));
      const __m512i difference = _mm512_sub_epi32(row, expected);
      const __m512i code =
          _mm512_xor_si512(_mm512_slli_epi32(difference, 1), _mm512_srai_epi32(difference, 31));
      _mm512_storeu_si512(differences, _mm512_maskz_compress_epi32(lanes(here), code));
      const int count = std::popcount(here);
      numbers += count;
      differences += count;
      last = numbers[-1];
      above_2 = above;
      above = row;
    }
    above_2_mask = above_mask;
    above_mask = here;
  }
}

PixelNumbers SubtractMasked(const TileMask& mask, const TileNumbers& numbers, PixelNumbers last,
                            TileNumbers* differences) {
  // Whole registers are read and written from the last pixel on.
  static_assert(kClassifyPadding >= kTilePx - 1);
  SubtractRows<true>(mask, numbers.depths.data(), last.depth, differences->depths.data());
  SubtractRows<false>(mask, numbers.colors.data(), last.color, differences->colors.data());
  const std::size_t count = PixelCount(mask);
  return count == 0 ? last : PixelNumbers{numbers.depths[count - 1], numbers.colors[count - 1]};
}

#else

PixelNumbers SubtractMasked(const TileMask& mask, const TileNumbers& numbers, PixelNumbers last,
                            TileNumbers* differences) {
  std::size_t i = 0;
  return WalkTile(mask, last, [&](const PixelNumbers& expected) {
    const PixelNumbers pixel{numbers.depths[i], numbers.colors[i]};
    differences->depths[i] = ZigZag(pixel.depth - expected.depth);
    differences->colors[i] = ZigZag(pixel.color - expected.color);
    ++i;
    return pixel;
  });
}

#endif

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace isoscope::composite
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace isoscope::composite {
namespace {
HWY_EXPORT(SubtractMasked);
}  // namespace

void TilePrediction::Subtract(const TileMask& mask, const TileNumbers& numbers,
                              TileNumbers* differences) {
  if (IsFull(mask)) {
    SubtractInFull<true>(numbers.depths.data(), last_.depth, differences->depths.data());
    SubtractInFull<false>(numbers.colors.data(), last_.color, differences->colors.data());
    last_ = {numbers.depths[kTilePixels - 1], numbers.colors[kTilePixels - 1]};
  } else {
    last_ = HWY_DYNAMIC_DISPATCH(SubtractMasked)(mask, numbers, last_, differences);
  }
}

}  // namespace isoscope::composite

#endif  // HWY_ONCE
