// The nearest fragment of each pixel, while meshes are drawn.
//
// A pixel is one word, depth bits << 32 | primitive id, so that the nearer of two fragments of
// different depth is the smaller word. If two fragments have the same depth, surface and then
// colour decide (docs/numerics.md, "Depth, fragments and exact culling"). Neither is known here, so
// the later of the two is kept in a list of ties until the pixel is shaded.
//
// Locks guard squares of 64 x 64 pixels, the lock tiles. A lock tile also notes which of its image
// tiles, and which rows of their pixels, may have fragments, so that the others are skipped.

#ifndef ISOSCOPE_CORE_RENDER_FRAGMENT_PLANE_H_
#define ISOSCOPE_CORE_RENDER_FRAGMENT_PLANE_H_

#include <array>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <thread>
#include <vector>

#include "core/base/large_pages.h"
#include "core/image/frame_image.h"
#include "core/render/cpu_rasterizer.h"
#include "core/render/fragment_shader.h"

namespace isoscope::render {

using DepthPrimitive = std::uint64_t;
inline constexpr DepthPrimitive kNoFragment = std::numeric_limits<DepthPrimitive>::max();
// The primitive id of a fragment whose owner and colour are in the image already. No mesh has it.
inline constexpr std::uint32_t kShaded = std::numeric_limits<std::uint32_t>::max();

// Merge is thread-safe. The functions for shading are thread-safe for different lock tiles, while
// no thread merges.
class FragmentPlane {
 public:
  // A fragment that has the depth of its pixel, an index of the image's planes.
  struct Tie {
    DepthPrimitive fragment = kNoFragment;
    std::uint32_t pixel = 0;
  };
  // An image tile that may have fragments, in the rows of pixels whose bits are set.
  struct ImageTile {
    int column = 0;
    int row = 0;
    std::uint16_t rows = 0;
    std::uint32_t bit = 0;  // of the lock tile's image tiles
  };

  // A plane without fragments.
  FragmentPlane(int width, int height);

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] std::size_t size_bytes() const { return words_.capacity() * sizeof(words_[0]); }

  // Puts fragments of one mesh into the plane. Triangle 0 of the mesh has `first_primitive_id`.
  void Merge(const FragmentBatch& batch, std::uint32_t first_primitive_id);
  [[nodiscard]] std::size_t tie_bytes() const {
    return tie_count_.load(std::memory_order_relaxed) * sizeof(Tie);
  }

  // Shading goes lock tile by lock tile: take the fragments of its image tiles, then its ties, then
  // call EndTile. After all tiles, call EndShading.
  [[nodiscard]] std::size_t lock_tile_count() const { return lock_tiles_.size(); }
  // Has a bit for each image tile that may have fragments.
  [[nodiscard]] std::uint32_t TouchedOf(std::size_t lock_tile) const {
    return lock_tiles_[lock_tile].touched;
  }
  // Calls visit(tile) for the image tiles of these bits, and prefetches the words of the next one.
  template <typename Visit>
  void ForEachImageTile(std::size_t lock_tile, std::uint32_t bits, const Visit& visit) const {
    for (std::uint32_t rest = bits; rest != 0; rest &= rest - 1) {
      if (const std::uint32_t later = rest & (rest - 1); later != 0) {
        Prefetch(TileOf(lock_tile, std::countr_zero(later)));
      }
      visit(TileOf(lock_tile, std::countr_zero(rest)));
    }
  }
  // Appends the fragments of a tile that are not shaded to `list`, and returns their pixels. They
  // count as shaded from then on; after the last shading of a pass no fragment is left. Prefetches
  // their pixels of `image`. REQUIRES: the list has room for kTilePixels.
  static constexpr std::size_t kTilePixels =
      std::size_t{image::TileSet::kTilePx} * image::TileSet::kTilePx;
  image::TileMask TakeFragments(const ImageTile& tile, bool is_last, const image::FrameImage& image,
                                ShadeList* list);
  [[nodiscard]] std::span<const Tie> TiesOf(std::size_t lock_tile) const {
    return lock_tiles_[lock_tile].ties;
  }
  void EndTile(std::size_t lock_tile, bool is_last);
  void EndShading(bool is_last);

  // Drops all fragments and ties, of an abandoned pass.
  void Clear();

 private:
  static constexpr int kLockTilePx = 64;
  // Columns of image tiles in a lock tile; it has as many rows.
  static constexpr int kImageTileColumns = kLockTilePx / image::TileSet::kTilePx;

  // A square of pixels that one thread at a time draws into. A thread holds it for well under a
  // microsecond, so waiting is spinning. A waiter yields in case the holder has lost its core.
  class alignas(64) LockTile {
   public:
    void Lock() {
      for (int tries = 0; is_locked_.test_and_set(std::memory_order_acquire); ++tries) {
        if (tries >= 64) {
          std::this_thread::yield();
        }
      }
    }
    void Unlock() { is_locked_.clear(std::memory_order_release); }
    // Marks the image tiles that `rect` meets. `row`, `column`: of this lock tile.
    void Touch(const view::PixelRect& rect, int row, int column);

    // The lock guards all of these.
    std::vector<Tie> ties;
    // Bit column + row * kImageTileColumns is set for each image tile that may have fragments.
    // touched_rows has a bit for each of its rows of pixels that may.
    std::uint32_t touched = 0;
    std::array<std::uint16_t, std::size_t{kImageTileColumns} * kImageTileColumns> touched_rows{};

   private:
    std::atomic_flag is_locked_;
  };
  class LockedTiles;

  template <typename Visit>
  void ForEachLockTile(const view::PixelRect& rect, const Visit& visit);
  [[nodiscard]] ImageTile TileOf(std::size_t lock_tile, int bit) const;
  void Prefetch(const ImageTile& tile) const;
  [[nodiscard]] std::size_t IndexOf(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
           static_cast<std::size_t>(x);
  }

  const int width_;
  const int height_;
  const int lock_columns_;
  base::LargePageVector<DepthPrimitive> words_;
  std::vector<LockTile> lock_tiles_;  // row by row
  std::atomic<std::size_t> tie_count_{0};
  bool has_shaded_ = false;  // words with kShaded may be left
};

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_FRAGMENT_PLANE_H_
