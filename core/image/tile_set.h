// Sets of tiles, the squares of an image that may have covered pixels, and masks of a tile's
// pixels.

#ifndef ISOSCOPE_CORE_IMAGE_TILE_SET_H_
#define ISOSCOPE_CORE_IMAGE_TILE_SET_H_

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace isoscope::image {

// One bit for each tile of kTilePx x kTilePx pixels. Thread-compatible: a row of tiles begins at a
// word, so that threads may change different rows.
class TileSet {
 public:
  static constexpr int kTilePx = 16;

  TileSet() = default;
  // Makes an empty set for an image of this size.
  TileSet(int width_px, int height_px)
      : columns_((width_px + kTilePx - 1) / kTilePx),
        rows_((height_px + kTilePx - 1) / kTilePx),
        row_words_(static_cast<std::size_t>((columns_ + 63) / 64)),
        words_(row_words_ * static_cast<std::size_t>(rows_)) {}

  [[nodiscard]] int columns() const { return columns_; }
  [[nodiscard]] int rows() const { return rows_; }

  void Insert(int column, int row) {
    words_[WordOf(column, row)] |= std::uint64_t{1} << (column % 64);
  }
  [[nodiscard]] bool Contains(int column, int row) const {
    return (words_[WordOf(column, row)] >> (column % 64) & 1) != 0;
  }
  // Inserts the tiles of the pixels [begin_x, end_x) x [begin_y, end_y).
  // REQUIRES: these lie inside the image.
  void InsertPixels(int begin_x, int begin_y, int end_x, int end_y) {
    for (int row = begin_y / kTilePx; row * kTilePx < end_y; ++row) {
      for (int column = begin_x / kTilePx; column * kTilePx < end_x; ++column) {
        Insert(column, row);
      }
    }
  }
  void InsertAll() {
    for (int row = 0; row < rows_; ++row) {
      for (int column = 0; column < columns_; ++column) {
        Insert(column, row);
      }
    }
  }
  void Clear() { words_.assign(words_.size(), 0); }

  [[nodiscard]] std::size_t Count() const {
    std::size_t count = 0;
    for (const std::uint64_t word : words_) {
      count += static_cast<std::size_t>(std::popcount(word));
    }
    return count;
  }

  // Calls fn(column) for each tile of a row that is in the set, ascending.
  template <typename Fn>
  void ForEachInRow(int row, const Fn& fn) const {
    for (std::size_t i = 0; i < row_words_; ++i) {
      for (std::uint64_t rest = words_[static_cast<std::size_t>(row) * row_words_ + i]; rest != 0;
           rest &= rest - 1) {
        fn(static_cast<int>(64 * i) + std::countr_zero(rest));
      }
    }
  }

  friend bool operator==(const TileSet&, const TileSet&) = default;

 private:
  [[nodiscard]] std::size_t WordOf(int column, int row) const {
    return static_cast<std::size_t>(row) * row_words_ + static_cast<std::size_t>(column / 64);
  }

  int columns_ = 0;
  int rows_ = 0;
  std::size_t row_words_ = 0;  // words of a row of tiles
  std::vector<std::uint64_t> words_;
};

// A mask of the pixels of a tile: bit `column` of element `row`.
using TileMask = std::array<std::uint16_t, TileSet::kTilePx>;

inline void UniteInto(const TileMask& more, TileMask* mask) {
  for (std::size_t row = 0; row < mask->size(); ++row) {
    (*mask)[row] = static_cast<std::uint16_t>((*mask)[row] | more[row]);
  }
}

}  // namespace isoscope::image

#endif  // ISOSCOPE_CORE_IMAGE_TILE_SET_H_
