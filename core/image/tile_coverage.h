// Finds the covered pixels of a tile, many at a time. An agent that draws a random share of the
// blocks touches nearly every tile, and covers little of each. So finding its pixels is most of the
// work.

#ifndef ISOSCOPE_CORE_IMAGE_TILE_COVERAGE_H_
#define ISOSCOPE_CORE_IMAGE_TILE_COVERAGE_H_

#include <cstddef>
#include <cstdint>

#include "core/image/tile_set.h"

namespace isoscope::image {

// Returns the pixels of a tile whose word, with the bits `ignored` set, is not `empty`. The same on
// every instruction set. Thread-safe.
//
// words:   the tile's first pixel; rows are `stride` words apart
// columns: pixels of a row that lie in the image, 1 .. TileSet::kTilePx
// rows:    bit `row` is set for each row to look at; these rows lie in the image
TileMask CoverageOf(const std::uint64_t* words, std::size_t stride, int columns, std::uint16_t rows,
                    std::uint64_t empty, std::uint64_t ignored = 0);

}  // namespace isoscope::image

#endif  // ISOSCOPE_CORE_IMAGE_TILE_COVERAGE_H_
