#include "core/image/tile_coverage.h"

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

// At most half a row: StoreMaskBits then writes one byte.
using D = hn::CappedTag<std::uint64_t, 8>;

TileMask CoverageOfWhole(const std::uint64_t* words, std::size_t stride, std::uint64_t empty,
                         std::uint64_t ignored) {
  const D d;
  const std::size_t lanes = hn::Lanes(d);
  const auto empty_lanes = hn::Set(d, empty);
  const auto ignored_lanes = hn::Set(d, ignored);
  TileMask mask;
  for (std::uint16_t& row : mask) {
    std::uint32_t bits = 0;
    for (std::size_t column = 0; column < TileSet::kTilePx; column += lanes) {
      const auto word = hn::Or(hn::LoadU(d, words + column), ignored_lanes);
      std::uint8_t covered[8] = {};  // as many as StoreMaskBits may write
      hn::StoreMaskBits(d, hn::Ne(word, empty_lanes), covered);
      bits |= std::uint32_t{covered[0]} << column;
    }
    row = static_cast<std::uint16_t>(bits);
    words += stride;
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

TileMask CoverageOf(const std::uint64_t* words, std::size_t stride, int columns, int rows,
                    std::uint64_t empty, std::uint64_t ignored) {
  if (columns == TileSet::kTilePx && rows == TileSet::kTilePx) {
    return HWY_DYNAMIC_DISPATCH(CoverageOfWhole)(words, stride, empty, ignored);
  }
  TileMask mask{};
  for (int row = 0; row < rows; ++row) {
    std::uint32_t bits = 0;
    for (int column = 0; column < columns; ++column) {
      bits |= std::uint32_t{(words[column] | ignored) != empty} << column;
    }
    mask[static_cast<std::size_t>(row)] = static_cast<std::uint16_t>(bits);
    words += stride;
  }
  return mask;
}

}  // namespace isoscope::image

#endif  // HWY_ONCE
