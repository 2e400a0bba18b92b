// A pixel's word over a pass:
//
//   1. Merge locks the lock tiles that the batch meets, row by row, and keeps the smaller word. A
//      fragment of equal depth goes to the tile's ties.
//   2. TakeFragments lists the words of an image tile that are not shaded. They become
//      depth << 32 | kShaded, or kNoFragment in the last shading of the pass.
//   3. EndTile drops the ties; EndShading tells the next pass whether shaded words are left.
//
// A shading in the middle of a pass keeps depths, so that later fragments are still compared with
// them. After the last one every word is kNoFragment, and no tile is touched.

#include "core/render/fragment_plane.h"

#include <algorithm>

#include "core/image/tile_coverage.h"

namespace isoscope::render {
namespace {

constexpr int kTilePx = image::TileSet::kTilePx;
// An idle lock tile keeps room for this many ties.
constexpr std::size_t kMaxIdleTies = 256;

}  // namespace

FragmentPlane::FragmentPlane(int width, int height)
    : width_(width),
      height_(height),
      lock_columns_((width + kLockTilePx - 1) / kLockTilePx),
      words_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), kNoFragment),
      lock_tiles_(static_cast<std::size_t>(lock_columns_) *
                  static_cast<std::size_t>((height + kLockTilePx - 1) / kLockTilePx)) {}

template <typename Visit>
void FragmentPlane::ForEachLockTile(const view::PixelRect& rect, const Visit& visit) {
  const int end_row = (rect.end_y - 1) / kLockTilePx;
  const int end_column = (rect.end_x - 1) / kLockTilePx;
  for (int row = rect.begin_y / kLockTilePx; row <= end_row; ++row) {
    for (int column = rect.begin_x / kLockTilePx; column <= end_column; ++column) {
      visit(row, column,
            lock_tiles_[static_cast<std::size_t>(row) * static_cast<std::size_t>(lock_columns_) +
                        static_cast<std::size_t>(column)]);
    }
  }
}

void FragmentPlane::LockTile::Touch(const view::PixelRect& rect, int row, int column) {
  const auto clip = [](int px, int lock_tile) {
    return std::clamp(px - lock_tile * kLockTilePx, 0, kLockTilePx);
  };
  const int begin_column = clip(rect.begin_x, column) / kTilePx;
  const int end_column = (clip(rect.end_x, column) + kTilePx - 1) / kTilePx;
  const int begin_y = clip(rect.begin_y, row);
  const int end_y = clip(rect.end_y, row);
  const std::uint32_t columns = (1U << end_column) - (1U << begin_column);
  for (int r = begin_y / kTilePx; r * kTilePx < end_y; ++r) {
    touched |= columns << (r * kImageTileColumns);
    const int begin = std::max(begin_y - r * kTilePx, 0);
    const int end = std::min(end_y - r * kTilePx, kTilePx);
    const auto rows = static_cast<std::uint16_t>((1U << end) - (1U << begin));
    for (int c = begin_column; c < end_column; ++c) {
      touched_rows[static_cast<std::size_t>(r) * kImageTileColumns + static_cast<std::size_t>(c)] |=
          rows;
    }
  }
}

// Holds the lock tiles that a rectangle meets, and marks the image tiles that it touches. Every
// thread takes them row by row, so that no threads wait for each other in a circle.
class FragmentPlane::LockedTiles {
 public:
  LockedTiles(FragmentPlane* plane, const view::PixelRect& rect) : plane_(*plane), rect_(rect) {
    plane_.ForEachLockTile(rect_, [&](int row, int column, LockTile& tile) {
      tile.Lock();
      tile.Touch(rect_, row, column);
    });
  }
  ~LockedTiles() {
    plane_.ForEachLockTile(rect_, [](int, int, LockTile& tile) { tile.Unlock(); });
  }
  LockedTiles(const LockedTiles&) = delete;
  LockedTiles& operator=(const LockedTiles&) = delete;

 private:
  FragmentPlane& plane_;
  const view::PixelRect rect_;
};

void FragmentPlane::Merge(const FragmentBatch& batch, std::uint32_t first_primitive_id) {
  const LockedTiles locked(this, batch.bounds);
  DepthPrimitive* const words = words_.data();
  const auto width = static_cast<std::uint32_t>(width_);
  for (std::size_t i = 0; i < batch.pixels.size(); ++i) {
    const std::uint32_t x = batch.pixels[i] & 0xffff;
    const std::uint32_t y = batch.pixels[i] >> 16;
    const std::uint32_t pixel = y * width + x;
    const DepthPrimitive fragment =
        DepthPrimitive{batch.depths[i]} << 32 | (first_primitive_id + batch.triangles[i]);
    DepthPrimitive& old = words[pixel];
    if (!image::HaveEqualDepth(old, fragment)) [[likely]] {
      old = std::min(old, fragment);
    } else {
      lock_tiles_[y / kLockTilePx * static_cast<std::size_t>(lock_columns_) + x / kLockTilePx]
          .ties.push_back({fragment, pixel});
      tie_count_.fetch_add(1, std::memory_order_relaxed);
    }
  }
}

FragmentPlane::ImageTile FragmentPlane::TileOf(std::size_t lock_tile, int bit) const {
  const int column = static_cast<int>(lock_tile) % lock_columns_;
  const int row = static_cast<int>(lock_tile) / lock_columns_;
  return {.column = column * kImageTileColumns + bit % kImageTileColumns,
          .row = row * kImageTileColumns + bit / kImageTileColumns,
          .rows = lock_tiles_[lock_tile].touched_rows[static_cast<std::size_t>(bit)],
          .bit = 1U << bit};
}

// The rows are too far apart for the processor to guess.
void FragmentPlane::Prefetch(const ImageTile& tile) const {
  constexpr std::size_t kLineWords = 64 / sizeof(DepthPrimitive);
  for (std::uint32_t rest = tile.rows; rest != 0; rest &= rest - 1) {
    const DepthPrimitive* const words =
        words_.data() + IndexOf(tile.column * kTilePx, tile.row * kTilePx + std::countr_zero(rest));
    for (std::size_t x = 0; x < kTilePx; x += kLineWords) {
      __builtin_prefetch(words + x);
    }
  }
}

image::TileMask FragmentPlane::TakeFragments(const ImageTile& tile, bool is_last,
                                             const image::FrameImage& image, ShadeList* list) {
  const int begin_x = tile.column * kTilePx;
  const int begin_y = tile.row * kTilePx;
  const int columns = std::min(kTilePx, width_ - begin_x);
  const int rows = std::min(kTilePx, height_ - begin_y);
  // With the ignored bits set, a shaded pixel and a pixel without fragment look the same.
  const image::TileMask unshaded =
      image::CoverageOf(words_.data() + IndexOf(begin_x, begin_y), static_cast<std::size_t>(width_),
                        columns, tile.rows, kNoFragment, ~DepthPrimitive{kShaded});
  ShadeBatch& batch = list->batch;
  std::size_t count = batch.count;
  for (int y = 0; y < rows; ++y) {
    const std::uint32_t row_mask = unshaded[static_cast<std::size_t>(y)];
    const std::size_t begin = IndexOf(begin_x, begin_y + y);
    DepthPrimitive* const words = words_.data() + begin;
    if (row_mask != 0) {
      // The image comes from a pool; its planes have left the processor's cache.
      for (int x = 0; x < columns; x += 8) {
        __builtin_prefetch(&image.keys[begin + static_cast<std::size_t>(x)], 1);
      }
      __builtin_prefetch(&image.colors[begin], 1);
    }
    for (std::uint32_t rest = row_mask; rest != 0; rest &= rest - 1) {
      const auto x = static_cast<std::uint32_t>(std::countr_zero(rest));
      const DepthPrimitive fragment = words[x];
      list->pixels[count] = static_cast<std::uint32_t>(begin) + x;
      list->depths[count] = static_cast<std::uint32_t>(fragment >> 32);
      list->primitive_ids[count] = static_cast<std::uint32_t>(fragment);
      batch.x[count] = static_cast<float>(begin_x) + static_cast<float>(x) + list->center_x;
      batch.y[count] = static_cast<float>(begin_y + y) + list->center_y;
      ++count;
      words[x] = is_last ? kNoFragment : fragment | kShaded;
    }
    if (is_last && has_shaded_) {
      std::fill_n(words, columns, kNoFragment);
    }
  }
  batch.count = count;
  return unshaded;
}

void FragmentPlane::EndTile(std::size_t lock_tile, bool is_last) {
  LockTile& tile = lock_tiles_[lock_tile];
  tile.ties.clear();
  // Unused planes must not keep the memory of one frame with many ties.
  if (tile.ties.capacity() > kMaxIdleTies) {
    tile.ties.shrink_to_fit();
  }
  if (is_last) {
    tile.touched = 0;
    tile.touched_rows = {};
  }
}

void FragmentPlane::EndShading(bool is_last) {
  has_shaded_ = !is_last;
  tie_count_.store(0, std::memory_order_relaxed);
}

void FragmentPlane::Clear() {
  for (std::size_t i = 0; i < lock_tiles_.size(); ++i) {
    if (lock_tiles_[i].touched == 0) {
      continue;
    }
    const int begin_x = static_cast<int>(i) % lock_columns_ * kLockTilePx;
    const int begin_y = static_cast<int>(i) / lock_columns_ * kLockTilePx;
    const int columns = std::min(kLockTilePx, width_ - begin_x);
    for (int y = begin_y; y < std::min(begin_y + kLockTilePx, height_); ++y) {
      std::fill_n(words_.begin() + static_cast<std::ptrdiff_t>(IndexOf(begin_x, y)), columns,
                  kNoFragment);
    }
    EndTile(i, /*is_last=*/true);
  }
  EndShading(/*is_last=*/true);
}

}  // namespace isoscope::render
