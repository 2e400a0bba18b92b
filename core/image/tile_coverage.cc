#include "core/image/tile_coverage.h"

#include <bit>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/image/tile_coverage.cc"
#include "hwy/foreach_target.h"  // IWYU pragma: keep
//
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::image {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// At most half a row of a tile: StoreMaskBits then writes one byte.
using D = hn::CappedTag<std::uint64_t, 8>;

TileMask CoverageOfWhole(const std::uint64_t* words, std::size_t stride, std::uint16_t rows,
                         std::uint64_t empty, std::uint64_t ignored) {
  const D d;
  const std::size_t lanes = hn::Lanes(d);
  const auto empty_lanes = hn::Set(d, empty);
  const auto ignored_lanes = hn::Set(d, ignored);
  TileMask mask{};
  for (std::uint32_t rest = rows; rest != 0; rest &= rest - 1) {
    const auto row = static_cast<std::size_t>(std::countr_zero(rest));
    const std::uint64_t* const first = words + row * stride;
    std::uint32_t bits = 0;
    for (std::size_t column = 0; column < TileSet::kTilePx; column += lanes) {
      const auto word = hn::Or(hn::LoadU(d, first + column), ignored_lanes);
      std::uint8_t covered[8] = {};  // StoreMaskBits may write up to 8
      hn::StoreMaskBits(d, hn::Ne(word, empty_lanes), covered);
      bits |= std::uint32_t{covered[0]} << column;
    }
    mask[row] = static_cast<std::uint16_t>(bits);
  }
  return mask;
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace isoscope::image
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace isoscope::image {

HWY_EXPORT(CoverageOfWhole);

TileMask CoverageOf(const std::uint64_t* words, std::size_t stride, int columns, std::uint16_t rows,
                    std::uint64_t empty, std::uint64_t ignored) {
  if (columns == TileSet::kTilePx) {
    return HWY_DYNAMIC_DISPATCH(CoverageOfWhole)(words, stride, rows, empty, ignored);
  }
  TileMask mask{};
  for (std::uint32_t rest = rows; rest != 0; rest &= rest - 1) {
    const auto row = static_cast<std::size_t>(std::countr_zero(rest));
    const std::uint64_t* const first = words + row * stride;
    std::uint32_t bits = 0;
    for (int column = 0; column < columns; ++column) {
      bits |= std::uint32_t{(first[column] | ignored) != empty} << column;
    }
    mask[row] = static_cast<std::uint16_t>(bits);
  }
  return mask;
}

}  // namespace isoscope::image

#endif  // HWY_ONCE
