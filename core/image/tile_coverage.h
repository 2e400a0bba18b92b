// Which pixels of a tile hold something, many at a time: who draws a random share of the blocks
// touches nearly every tile and covers little of it, so that looking is most of the work.

#ifndef ISOSCOPE_CORE_IMAGE_TILE_COVERAGE_H_
#define ISOSCOPE_CORE_IMAGE_TILE_COVERAGE_H_

#include <cstddef>
#include <cstdint>

#include "core/image/tile_set.h"

namespace isoscope::image {

// The pixels of the tile at `words` (rows `stride` apart, of which `columns` pixels lie in the
// image) whose word, with the bits `ignored` set, is not `empty`. Of the rows whose bit is set in
// `rows` only. In vector lanes; the same on every instruction set. REQUIRES: 1 <= columns <=
// TileSet::kTilePx; the rows lie in the image.
TileMask CoverageOf(const std::uint64_t* words, std::size_t stride, int columns, std::uint16_t rows,
                    std::uint64_t empty, std::uint64_t ignored = 0);

}  // namespace isoscope::image

#endif  // ISOSCOPE_CORE_IMAGE_TILE_COVERAGE_H_
