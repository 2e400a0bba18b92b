// A set of blocks of one volume, as bricks of 4 x 4 x 4 blocks. It has a word for each brick that
// has members, and of each other brick it knows how far away the next one with members is. So a ray
// crosses empty space in few steps, and the memory follows the members.
//
// Bricks may reach beyond the volume; there they are empty.

#ifndef ISOSCOPE_CORE_VOLUME_BLOCK_TREE_H_
#define ISOSCOPE_CORE_VOLUME_BLOCK_TREE_H_

#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "absl/types/span.h"

#include "core/math/vec.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_set.h"

namespace isoscope::volume {

// Up to this many blocks, a set takes half a megabyte, and rays that walk from block to block are as
// fast or faster (docs/lab/experiments.md). Larger volumes keep their active blocks as trees.
inline constexpr std::int64_t kMaxDenseBlocks = std::int64_t{1} << 22;

// Immutable; thread-safe. Memory: 4 bytes for each brick of the volume, and 12 bytes for each brick
// with members: size_bytes(). There are about block_count / 64 bricks.
class BlockTree {
 public:
  static constexpr int kBrickBits = 2;
  static constexpr std::int64_t kBrickSide = std::int64_t{1} << kBrickBits;  // blocks

  // A brick and its members: bit x + 4 y + 16 z of `blocks` is the block at (x, y, z) in it.
  struct Brick {
    std::uint32_t index = 0;  // x fastest, then y, then z, in brick_dims()
    std::uint64_t blocks = 0;
  };

  BlockTree() = default;
  // REQUIRES: the bricks are distinct, and their members blocks of the volume. O(bricks of the
  // volume).
  BlockTree(const math::Index3& block_dims, absl::Span<const Brick> bricks);
  // REQUIRES: a set of Volume(block_dims) blocks. O(blocks / 64 + members).
  BlockTree(const math::Index3& block_dims, const BlockSet& blocks);
  // Returns the blocks that are in any of the trees. REQUIRES: at least one; all of one volume.
  static BlockTree Union(absl::Span<const BlockTree* const> trees);

  [[nodiscard]] const math::Index3& block_dims() const { return block_dims_; }
  [[nodiscard]] const math::Index3& brick_dims() const { return brick_dims_; }
  // The number of members.
  [[nodiscard]] std::int64_t count() const { return count_; }
  [[nodiscard]] std::size_t size_bytes() const;

  // Where a block is in the words: brick_index * 64 + bit. REQUIRES: within block_dims().
  [[nodiscard]] std::int64_t CodeOf(const math::Index3& block_index) const {
    const std::int64_t brick = (block_index.x >> kBrickBits) +
                               brick_dims_.x * ((block_index.y >> kBrickBits) +
                                                brick_dims_.y * (block_index.z >> kBrickBits));
    return brick << 6 | (block_index.z & 3) << 4 | (block_index.y & 3) << 2 | (block_index.x & 3);
  }
  [[nodiscard]] std::int64_t CodeOf(BlockId id) const;
  [[nodiscard]] bool Contains(BlockId id) const;

  // By brick index: the index of its word, or kEmpty plus the distance to the next brick that has
  // members: the greatest of the differences on the three axes, at least 1. Without a member it is
  // the greatest of brick_dims().
  [[nodiscard]] absl::Span<const std::uint32_t> cells() const { return cells_; }
  static constexpr std::uint32_t kEmpty = 0x80000000;
  // The members of bricks that have any, and the indices of these bricks, ascending.
  [[nodiscard]] absl::Span<const std::uint64_t> words() const { return words_; }
  [[nodiscard]] absl::Span<const std::uint32_t> bricks() const { return bricks_; }

  // Returns the blocks, ascending, that are set in `marks`. They have the shape of words().
  // O(words()).
  [[nodiscard]] std::vector<BlockId> IdsOf(absl::Span<const std::uint64_t> marks) const;
  // Returns the members, ascending, or as a set.
  [[nodiscard]] std::vector<BlockId> Ids() const { return IdsOf(words_); }
  [[nodiscard]] BlockSet ToSet() const;

  // Returns the marks of the members that are set in `marks`, or are one of their 26 neighbours. Marks
  // have the shape of words(). O(words()).
  [[nodiscard]] std::vector<std::uint64_t> WithNeighbours(
      absl::Span<const std::uint64_t> marks) const;

  // Returns the members for which keep(block index) is true.
  template <typename Keep>
  [[nodiscard]] BlockTree Filtered(const Keep& keep) const;

  // Returns the block index of a bit of a brick.
  [[nodiscard]] math::Index3 IndexOf(std::uint32_t brick, int bit) const;

  friend bool operator==(const BlockTree&, const BlockTree&) = default;

 private:
  // Makes cells_ and count_ of words_ and bricks_.
  void FillCells();

  math::Index3 block_dims_;
  math::Index3 brick_dims_;
  std::int64_t count_ = 0;
  std::vector<std::uint32_t> cells_;
  std::vector<std::uint64_t> words_;
  std::vector<std::uint32_t> bricks_;
};

template <typename Keep>
BlockTree BlockTree::Filtered(const Keep& keep) const {
  std::vector<Brick> kept;
  for (std::size_t i = 0; i < words_.size(); ++i) {
    Brick brick{bricks_[i], 0};
    for (std::uint64_t rest = words_[i]; rest != 0; rest &= rest - 1) {
      if (keep(IndexOf(bricks_[i], std::countr_zero(rest)))) {
        brick.blocks |= rest & (~rest + 1);
      }
    }
    if (brick.blocks != 0) {
      kept.push_back(brick);
    }
  }
  return BlockTree(block_dims_, kept);
}

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_BLOCK_TREE_H_
