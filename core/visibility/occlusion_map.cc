// A pyramid of farthest depths over the composited image. Mip level 0 has a texel for each pixel; a
// texel of level L + 1 holds the farthest of the 2 x 2 texels below it. Levels 0 to 3 lie tile by
// tile:
//
//        offset   0              256           320          336     340
//                 | 16 x 16      | 8 x 8       | 4 x 4      | 2 x 2 |     floats of one tile
//
// Level 4 has one texel a tile and, with the coarser levels, is stored as a plane. All tiles
// without a fragment share the first stored tile, which is uncovered throughout.
//
// Hides begins at a level at which the rectangle is a few texels wide. A texel nearer than the
// block decides for all its pixels. Any other texel makes the answer false if all its pixels are in
// the rectangle, because its farthest pixel is one of them. Else its children inside the rectangle
// decide. So only texels on the rectangle's border are refined, and the answer equals a test of all
// pixels.
//
// Example: 20 x 9 pixels, x from 30 to 49 and y from 5 to 13, begin at level 3, as 20 >> 3 = 2 is
// the first shift that gives at most 4: texels of 8 x 8 pixels, 3 to 6 across and 0 to 1 down,
// eight tests, where testing each pixel would take 180.
//
// Invariants: an uncovered pixel is 2, farther than any depth; a texel outside the image is 0,
// nearer than any limit but 0, at which nothing is hidden. Nothing is rounded: depths stay
// binary32. For MapKind::kMask a covered pixel is 0 and the limit is 2.
//
// Proof of exactness: docs/numerics.md, "Depth, fragments and exact culling".

#include "core/visibility/occlusion_map.h"

#include <algorithm>
#include <utility>

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/base/check.h"

namespace isoscope::visibility {
namespace {

constexpr int kTilePx = image::TileSet::kTilePx;

// Hides begins at the finest level at which a rectangle's longer side is at most this many texels.
constexpr int kStartTexels = 4;

float Farther(float a, float b) { return a > b ? a : b; }

// Writes the farthest of each 2 x 2 texels of a square of 2 kSide x 2 kSide.
template <int kSide>
void Halve(const float* fine, float* coarse) {
  for (int y = 0; y < kSide; ++y) {
    const float* upper = fine + 4 * kSide * y;
    const float* lower = upper + 2 * kSide;
    for (int x = 0; x < kSide; ++x) {
      coarse[kSide * y + x] =
          Farther(Farther(upper[2 * x], upper[2 * x + 1]), Farther(lower[2 * x], lower[2 * x + 1]));
    }
  }
}

// Returns one bit a texel of [begin_x, end_x), lowest first: set if the texel is not nearer than
// `limit`. At most 32 texels.
std::uint32_t OpenBits(const float* texels, int begin_x, int end_x, float limit) {
  std::uint32_t bits = 0;
  int x = begin_x;
  // Four independent comparisons a step, so that none waits for the one before.
  for (; x + 4 <= end_x; x += 4) {
    const std::uint32_t four =
        std::uint32_t{!(texels[x] < limit)} | std::uint32_t{!(texels[x + 1] < limit)} << 1 |
        std::uint32_t{!(texels[x + 2] < limit)} << 2 | std::uint32_t{!(texels[x + 3] < limit)} << 3;
    bits |= four << (x - begin_x);
  }
  for (; x < end_x; ++x) {
    bits |= std::uint32_t{!(texels[x] < limit)} << (x - begin_x);
  }
  return bits;
}

int CellCount(int begin_px, int end_px, int shift) {
  return ((end_px - 1) >> shift) - (begin_px >> shift) + 1;
}

}  // namespace

image::PixelMask ClosedMaskOf(const view::PixelRect& rect) {
  image::PixelMask mask;
  if (rect.empty()) {
    return mask;
  }
  ISOSCOPE_CHECK_GE(rect.begin_x, 0);
  ISOSCOPE_CHECK_GE(rect.begin_y, 0);
  while (CellCount(rect.begin_x, rect.end_x, mask.shift) > kMaxMaskSide ||
         CellCount(rect.begin_y, rect.end_y, mask.shift) > kMaxMaskSide) {
    ++mask.shift;
  }
  mask.begin_column = rect.begin_x >> mask.shift;
  mask.begin_row = rect.begin_y >> mask.shift;
  mask.columns = CellCount(rect.begin_x, rect.end_x, mask.shift);
  mask.rows = CellCount(rect.begin_y, rect.end_y, mask.shift);
  mask.words.assign(static_cast<std::size_t>((mask.columns * mask.rows + 63) / 64), 0);
  return mask;
}

OcclusionMap OcclusionMap::FromImage(const image::FrameImage& image, MapKind kind) {
  ISOSCOPE_CHECK_GE(image.width, 1);
  ISOSCOPE_CHECK_GE(image.height, 1);
  OcclusionMap map;
  map.kind_ = kind;
  map.width_px_ = image.width;
  map.height_px_ = image.height;
  map.BuildTiles(image);
  map.BuildPlanes();
  return map;
}

void OcclusionMap::BuildTiles(const image::FrameImage& image) {
  const int columns = image.touched.columns();
  const int rows = image.touched.rows();
  Plane plane;
  plane.width = columns;
  plane.height = rows;
  const std::size_t tile_count = static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows);
  plane.texels.assign(tile_count, kUncovered);
  stored_index_.assign(tile_count, 0);
  std::uint32_t stored_count = 1;
  for (int row = 0; row < rows; ++row) {
    std::uint32_t* row_indices =
        stored_index_.data() + static_cast<std::size_t>(row) * static_cast<std::size_t>(columns);
    image.touched.ForEachInRow(row, [&](int column) { row_indices[column] = stored_count++; });
  }
  // Memory is not cleared: every texel is written below.
  tiles_ = std::make_unique_for_overwrite<float[]>(stored_count * kTileTexels);
  std::fill_n(tiles_.get(), kTileTexels, kUncovered);

  const bool is_mask = kind_ == MapKind::kMask;
  const auto build_row = [&](int row) {
    const std::size_t first_tile =
        static_cast<std::size_t>(row) * static_cast<std::size_t>(columns);
    const int tile_height = std::min(kTilePx, image.height - row * kTilePx);
    image.touched.ForEachInRow(row, [&](int column) {
      const std::size_t tile = first_tile + static_cast<std::size_t>(column);
      float* texels = tiles_.get() + stored_index_[tile] * kTileTexels;
      const int tile_width = std::min(kTilePx, image.width - column * kTilePx);
      // Texels outside the image are nearer than everything, so coarser texels ignore them.
      if (tile_width < kTilePx || tile_height < kTilePx) {
        std::fill_n(texels, kMipLevelOffset[1], 0.0F);
      }
      for (int y = 0; y < tile_height; ++y) {
        const std::uint64_t* keys =
            image.keys.data() + image.IndexOf(column * kTilePx, row * kTilePx + y);
        float* to = texels + kTilePx * y;
        for (int x = 0; x < tile_width; ++x) {
          const float depth = is_mask ? 0.0F : image::DepthOf(keys[x]);
          to[x] = keys[x] == image::kBackgroundKey ? kUncovered : depth;
        }
      }
      Halve<8>(texels, texels + kMipLevelOffset[1]);
      Halve<4>(texels + kMipLevelOffset[1], texels + kMipLevelOffset[2]);
      Halve<2>(texels + kMipLevelOffset[2], texels + kMipLevelOffset[3]);
      Halve<1>(texels + kMipLevelOffset[3], &plane.texels[tile]);
    });
  };
  tbb::parallel_for(tbb::blocked_range<int>(0, rows), [&](const tbb::blocked_range<int>& range) {
    for (int row = range.begin(); row < range.end(); ++row) {
      build_row(row);
    }
  });
  planes_.push_back(std::move(plane));
}

void OcclusionMap::BuildPlanes() {
  while (planes_.back().width > 1 || planes_.back().height > 1) {
    const Plane& fine = planes_.back();
    Plane coarse;
    coarse.width = (fine.width + 1) / 2;
    coarse.height = (fine.height + 1) / 2;
    coarse.texels.resize(static_cast<std::size_t>(coarse.width) *
                         static_cast<std::size_t>(coarse.height));
    for (int y = 0; y < fine.height; ++y) {
      const float* from =
          fine.texels.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(fine.width);
      float* to = coarse.texels.data() +
                  static_cast<std::size_t>(y / 2) * static_cast<std::size_t>(coarse.width);
      for (int x = 0; x < fine.width; ++x) {
        to[x / 2] = Farther(to[x / 2], from[x]);
      }
    }
    planes_.push_back(std::move(coarse));
  }
}

float OcclusionMap::TexelAt(int mip_level, int x, int y) const {
  if (mip_level >= kTileMipLevels) {
    const Plane& plane = planes_[static_cast<std::size_t>(mip_level - kTileMipLevels)];
    return plane.texels[static_cast<std::size_t>(y) * static_cast<std::size_t>(plane.width) +
                        static_cast<std::size_t>(x)];
  }
  const int side_bits = kTileMipLevels - mip_level;
  const int mask = (1 << side_bits) - 1;
  const std::size_t tile =
      static_cast<std::size_t>(y >> side_bits) * static_cast<std::size_t>(planes_.front().width) +
      static_cast<std::size_t>(x >> side_bits);
  return tiles_[stored_index_[tile] * kTileTexels +
                kMipLevelOffset[static_cast<std::size_t>(mip_level)] +
                static_cast<std::size_t>((y & mask) << side_bits | (x & mask))];
}

bool OcclusionMap::IsNearer(int mip_level, int x, int y, const view::PixelRect& rect,
                            float limit) const {
  if (TexelAt(mip_level, x, y) < limit) {
    return true;
  }
  // The pixels of this texel, and those of them that lie in the rectangle.
  const view::PixelRect whole{x << mip_level, y << mip_level,
                              std::min((x + 1) << mip_level, width_px_),
                              std::min((y + 1) << mip_level, height_px_)};
  const view::PixelRect common{
      std::max(whole.begin_x, rect.begin_x), std::max(whole.begin_y, rect.begin_y),
      std::min(whole.end_x, rect.end_x), std::min(whole.end_y, rect.end_y)};
  if (common == whole) {
    return false;  // the farthest pixel is in the rectangle
  }
  const int finer = mip_level - 1;
  for (int child_y = common.begin_y >> finer; child_y <= (common.end_y - 1) >> finer; ++child_y) {
    for (int child_x = common.begin_x >> finer; child_x <= (common.end_x - 1) >> finer; ++child_x) {
      if (!IsNearer(finer, child_x, child_y, common, limit)) {
        return false;
      }
    }
  }
  return true;
}

bool OcclusionMap::Hides(const view::Footprint& footprint) const {
  if (planes_.empty()) {
    return false;
  }
  const view::PixelRect& rect = footprint.rect;
  if (rect.empty()) {
    return true;
  }
  ISOSCOPE_CHECK(rect.begin_x >= 0 && rect.begin_y >= 0 && rect.end_x <= width_px_ &&
                 rect.end_y <= height_px_);
  const float limit = LimitOf(footprint);
  const int extent = std::max(rect.end_x - rect.begin_x, rect.end_y - rect.begin_y);
  int mip_level = 0;
  while (extent >> mip_level > kStartTexels && mip_level + 1 < mip_level_count()) {
    ++mip_level;
  }
  for (int y = rect.begin_y >> mip_level; y <= (rect.end_y - 1) >> mip_level; ++y) {
    for (int x = rect.begin_x >> mip_level; x <= (rect.end_x - 1) >> mip_level; ++x) {
      if (!IsNearer(mip_level, x, y, rect, limit)) {
        return false;
      }
    }
  }
  return true;
}

std::uint32_t OcclusionMap::OpenTexels(int mip_level, int y, int begin_x, int end_x,
                                       float limit) const {
  if (mip_level >= kTileMipLevels) {
    const Plane& plane = planes_[static_cast<std::size_t>(mip_level - kTileMipLevels)];
    return OpenBits(
        plane.texels.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(plane.width),
        begin_x, end_x, limit);
  }
  const int side_bits = kTileMipLevels - mip_level;
  const int side = 1 << side_bits;
  const std::uint32_t* row_indices =
      stored_index_.data() +
      static_cast<std::size_t>(y >> side_bits) * static_cast<std::size_t>(planes_.front().width);
  const std::size_t row = kMipLevelOffset[static_cast<std::size_t>(mip_level)] +
                          (static_cast<std::size_t>(y & (side - 1)) << side_bits);
  std::uint32_t open = 0;
  for (int x = begin_x; x < end_x;) {
    const int tile_x = x & -side;
    const int tile_end_x = std::min(tile_x + side, end_x);
    const float* texels = tiles_.get() + row_indices[x >> side_bits] * kTileTexels + row;
    open |= OpenBits(texels, x - tile_x, tile_end_x - tile_x, limit) << (x - begin_x);
    x = tile_end_x;
  }
  return open;
}

image::PixelMask OcclusionMap::OpenPixels(const view::Footprint& footprint) const {
  image::PixelMask mask = ClosedMaskOf(footprint.rect);
  const bool covers_nothing = planes_.empty();
  ISOSCOPE_CHECK(covers_nothing || footprint.rect.empty() ||
                 (footprint.rect.end_x <= width_px_ && footprint.rect.end_y <= height_px_));
  const float limit = LimitOf(footprint);
  const std::uint32_t all = mask.columns == 32 ? ~0U : (1U << mask.columns) - 1;
  std::size_t bit = 0;
  for (int row = 0; row < mask.rows; ++row) {
    const std::uint64_t open = covers_nothing
                                   ? all
                                   : OpenTexels(mask.shift, mask.begin_row + row, mask.begin_column,
                                                mask.begin_column + mask.columns, limit);
    mask.words[bit / 64] |= open << (bit % 64);
    if (bit % 64 + static_cast<std::size_t>(mask.columns) > 64) {
      mask.words[bit / 64 + 1] |= open >> (64 - bit % 64);
    }
    bit += static_cast<std::size_t>(mask.columns);
  }
  return mask;
}

}  // namespace isoscope::visibility
