// The words of bricks with members lie in ascending order of brick indices; cells_ finds them:
//
//        cells_    [E1] [ 0] [E1] [E1] [ 1] ...     one for each brick of the volume
//        words_         [w0]           [w1]         one for each brick with members
//        bricks_        [ 1]           [ 4]         their brick indices
//
// E1 says that the brick is empty, and that one of its 26 neighbours is not. Two passes over all
// bricks find the distances: a brick is one farther away than the nearest of its neighbours. The
// first pass takes those of the 26 that come before it in memory, the second those that follow.
//
// Example: 12 x 4 x 4 blocks are 3 bricks. With one member, at (1, 0, 0), brick 0 has the word
// 1 << 1, and the others are E1 and E2.
//
// Source of the passes: Rosenfeld and Pfaltz 1968 (references.bib: rosenfeld-pfaltz).

#include "core/volume/block_tree.h"

#include <algorithm>
#include <bit>

#include "core/base/check.h"

namespace isoscope::volume {
namespace {

std::int64_t DivideUp(std::int64_t value, std::int64_t divisor) {
  return (value + divisor - 1) / divisor;
}

math::Index3 BrickDims(const math::Index3& block_dims) {
  return {DivideUp(block_dims.x, BlockTree::kBrickSide),
          DivideUp(block_dims.y, BlockTree::kBrickSide),
          DivideUp(block_dims.z, BlockTree::kBrickSide)};
}

// Distances of bricks to the next one that has members, row by row.
class DistanceField {
 public:
  DistanceField(const math::Index3& dims, std::vector<std::uint32_t>* distances)
      : dims_(dims),
        distances_(distances->data()),
        row_(static_cast<std::size_t>(dims.x)),
        far_(static_cast<std::size_t>(dims.x), kFar) {}

  // REQUIRES: a distance is 0 where there are members, and at least the greatest of dims elsewhere.
  void Find() {
    for (std::int64_t z = 0; z < dims_.z; ++z) {
      PassSlab(z, 1);
    }
    for (std::int64_t z = dims_.z; z-- > 0;) {
      PassSlab(z, -1);
    }
  }

 private:
  static constexpr std::uint32_t kFar = BlockTree::kEmpty;

  [[nodiscard]] std::uint32_t* RowAt(std::int64_t y, std::int64_t z) const {
    return distances_ + dims_.x * (y + dims_.y * z);
  }

  // A pass in the direction `step` of the axes.
  void PassSlab(std::int64_t z, std::int64_t step) {
    const bool has_slab = z - step >= 0 && z - step < dims_.z;
    for (std::int64_t i = 0; i < dims_.y; ++i) {
      const std::int64_t y = step > 0 ? i : dims_.y - 1 - i;
      // The nearest of the neighbours in other rows that were passed: on each column, then of three.
      std::copy(far_.begin(), far_.end(), row_.begin());
      for (std::int64_t other = y - 1; other <= y + 1; ++other) {
        if (has_slab && other >= 0 && other < dims_.y) {
          TakeNearer(RowAt(other, z - step));
        }
      }
      if (y - step >= 0 && y - step < dims_.y) {
        TakeNearer(RowAt(y - step, z));
      }
      PassRow(RowAt(y, z), step);
    }
  }

  void TakeNearer(const std::uint32_t* other) {
    for (std::size_t x = 0; x < row_.size(); ++x) {
      row_[x] = std::min(row_[x], other[x]);
    }
  }

  void PassRow(std::uint32_t* distances, std::int64_t step) {
    const std::size_t count = row_.size();
    for (std::size_t x = 0; x < count; ++x) {
      std::uint32_t nearest = row_[x];
      nearest = x > 0 ? std::min(nearest, row_[x - 1]) : nearest;
      nearest = x + 1 < count ? std::min(nearest, row_[x + 1]) : nearest;
      distances[x] = std::min(distances[x], nearest + 1);
    }
    std::uint32_t before = kFar;
    for (std::size_t i = 0; i < count; ++i) {
      std::uint32_t& distance = distances[step > 0 ? i : count - 1 - i];
      distance = std::min(distance, before + 1);
      before = distance;
    }
  }

  const math::Index3 dims_;
  std::uint32_t* const distances_;
  std::vector<std::uint32_t> row_;
  const std::vector<std::uint32_t> far_;
};

// The bits of a brick's blocks at the lower and the upper end of each axis.
constexpr std::uint64_t kLowest[] = {0x1111111111111111, 0x000f000f000f000f, 0x000000000000ffff};
constexpr std::uint64_t kHighest[] = {0x8888888888888888, 0xf000f000f000f000, 0xffff000000000000};

// The blocks of a brick and their neighbours along an axis: in the brick before, the brick, and the
// brick behind.
struct Spread {
  std::uint64_t parts[3];
};
Spread SpreadAlong(int axis, std::uint64_t blocks) {
  const int step = 1 << (2 * axis);
  return {{(blocks & kLowest[axis]) << (3 * step),
           blocks | (blocks & ~kHighest[axis]) << step | (blocks & ~kLowest[axis]) >> step,
           (blocks & kHighest[axis]) >> (3 * step)}};
}

}  // namespace

BlockTree::BlockTree(const math::Index3& block_dims, absl::Span<const Brick> bricks)
    : block_dims_(block_dims), brick_dims_(BrickDims(block_dims)) {
  // Sorted by way of the cells: each brick has one place there.
  cells_.assign(static_cast<std::size_t>(math::Volume(brick_dims_)), kEmpty);
  for (std::size_t i = 0; i < bricks.size(); ++i) {
    ISOSCOPE_CHECK_LT(bricks[i].index, cells_.size());
    cells_[bricks[i].index] = static_cast<std::uint32_t>(i);
  }
  words_.reserve(bricks.size());
  bricks_.reserve(bricks.size());
  for (std::size_t brick = 0; brick < cells_.size(); ++brick) {
    if (cells_[brick] < kEmpty && bricks[cells_[brick]].blocks != 0) {
      words_.push_back(bricks[cells_[brick]].blocks);
      bricks_.push_back(static_cast<std::uint32_t>(brick));
    }
  }
  FillCells();
}

BlockTree::BlockTree(const math::Index3& block_dims, const BlockSet& blocks)
    : block_dims_(block_dims), brick_dims_(BrickDims(block_dims)) {
  // A word for every brick, of which those with members are kept.
  std::vector<std::uint64_t> all(static_cast<std::size_t>(math::Volume(brick_dims_)));
  const absl::Span<const std::uint64_t> words = blocks.words();
  ISOSCOPE_CHECK_EQ(static_cast<std::int64_t>(words.size()),
                    DivideUp(math::Volume(block_dims), 64));
  for (std::size_t i = 0; i < words.size(); ++i) {
    for (std::uint64_t word = words[i]; word != 0; word &= word - 1) {
      const std::int64_t code =
          CodeOf(static_cast<BlockId>(i * 64 + static_cast<std::size_t>(std::countr_zero(word))));
      all[static_cast<std::size_t>(code >> 6)] |= std::uint64_t{1} << (code & 63);
    }
  }
  for (std::size_t brick = 0; brick < all.size(); ++brick) {
    if (all[brick] != 0) {
      words_.push_back(all[brick]);
      bricks_.push_back(static_cast<std::uint32_t>(brick));
    }
  }
  FillCells();
}

BlockTree BlockTree::Union(absl::Span<const BlockTree* const> trees) {
  ISOSCOPE_CHECK(!trees.empty());
  BlockTree united;
  united.block_dims_ = trees.front()->block_dims_;
  united.brick_dims_ = trees.front()->brick_dims_;
  // Merges two ascending lists at a time.
  for (const BlockTree* tree : trees) {
    ISOSCOPE_CHECK(tree->block_dims_ == united.block_dims_);
    std::vector<std::uint64_t> words;
    std::vector<std::uint32_t> bricks;
    std::size_t a = 0;
    std::size_t b = 0;
    while (a < united.bricks_.size() || b < tree->bricks_.size()) {
      const bool takes_a = b == tree->bricks_.size() ||
                           (a < united.bricks_.size() && united.bricks_[a] <= tree->bricks_[b]);
      const bool takes_b = a == united.bricks_.size() ||
                           (b < tree->bricks_.size() && tree->bricks_[b] <= united.bricks_[a]);
      bricks.push_back(takes_a ? united.bricks_[a] : tree->bricks_[b]);
      words.push_back((takes_a ? united.words_[a] : 0) | (takes_b ? tree->words_[b] : 0));
      a += takes_a ? 1 : 0;
      b += takes_b ? 1 : 0;
    }
    united.words_ = std::move(words);
    united.bricks_ = std::move(bricks);
  }
  united.FillCells();
  return united;
}

void BlockTree::FillCells() {
  words_.shrink_to_fit();
  bricks_.shrink_to_fit();
  const std::int64_t most = std::max({brick_dims_.x, brick_dims_.y, brick_dims_.z});
  cells_.assign(static_cast<std::size_t>(math::Volume(brick_dims_)),
                static_cast<std::uint32_t>(most));
  count_ = 0;
  for (std::size_t i = 0; i < words_.size(); ++i) {
    cells_[bricks_[i]] = 0;
    count_ += std::popcount(words_[i]);
  }
  if (!words_.empty()) {
    DistanceField(brick_dims_, &cells_).Find();
  }
  for (std::uint32_t& cell : cells_) {
    cell += kEmpty;
  }
  for (std::size_t i = 0; i < words_.size(); ++i) {
    cells_[bricks_[i]] = static_cast<std::uint32_t>(i);
  }
}

std::size_t BlockTree::size_bytes() const {
  return sizeof(*this) + cells_.capacity() * sizeof(cells_[0]) +
         words_.capacity() * sizeof(words_[0]) + bricks_.capacity() * sizeof(bricks_[0]);
}

std::int64_t BlockTree::CodeOf(BlockId id) const {
  const std::int64_t row = id / block_dims_.x;
  return CodeOf({id % block_dims_.x, row % block_dims_.y, row / block_dims_.y});
}

bool BlockTree::Contains(BlockId id) const {
  const std::int64_t code = CodeOf(id);
  const std::uint32_t cell = cells_[static_cast<std::size_t>(code >> 6)];
  return cell < kEmpty && (words_[cell] >> (code & 63) & 1) != 0;
}

math::Index3 BlockTree::IndexOf(std::uint32_t brick, int bit) const {
  const std::int64_t row = brick / brick_dims_.x;
  return {brick % brick_dims_.x * kBrickSide + (bit & 3),
          row % brick_dims_.y * kBrickSide + (bit >> 2 & 3),
          row / brick_dims_.y * kBrickSide + (bit >> 4)};
}

std::vector<BlockId> BlockTree::IdsOf(absl::Span<const std::uint64_t> marks) const {
  ISOSCOPE_CHECK_EQ(marks.size(), words_.size());
  std::int64_t mark_count = 0;
  for (const std::uint64_t word : marks) {
    mark_count += std::popcount(word);
  }
  std::vector<BlockId> ids;
  ids.reserve(static_cast<std::size_t>(mark_count));
  // The words of a row of bricks, and of a slab of rows, follow one another. Four layers of blocks
  // go through a slab, and four rows of blocks through a row of bricks.
  const std::uint32_t slab_bricks = static_cast<std::uint32_t>(brick_dims_.x * brick_dims_.y);
  std::vector<std::size_t> row_begins;
  for (std::size_t begin = 0; begin < bricks_.size();) {
    const std::uint32_t slab = bricks_[begin] / slab_bricks;
    std::size_t end = begin;
    std::int64_t last_row = -1;
    row_begins.clear();
    for (; end < bricks_.size() && bricks_[end] / slab_bricks == slab; ++end) {
      const std::int64_t row = bricks_[end] / brick_dims_.x;
      if (row != last_row) {
        row_begins.push_back(end);
        last_row = row;
      }
    }
    row_begins.push_back(end);
    for (int z = 0; z < kBrickSide; ++z) {
      for (std::size_t row = 0; row + 1 < row_begins.size(); ++row) {
        for (int y = 0; y < kBrickSide; ++y) {
          for (std::size_t i = row_begins[row]; i < row_begins[row + 1]; ++i) {
            const auto four = static_cast<unsigned>(marks[i] >> (16 * z + 4 * y) & 15);
            if (four == 0) {
              continue;
            }
            const math::Index3 at = IndexOf(bricks_[i], 16 * z + 4 * y);
            const std::int64_t first = at.x + block_dims_.x * (at.y + block_dims_.y * at.z);
            for (unsigned rest = four; rest != 0; rest &= rest - 1) {
              ids.push_back(static_cast<BlockId>(first + std::countr_zero(rest)));
            }
          }
        }
      }
    }
    begin = end;
  }
  return ids;
}

std::vector<std::uint64_t> BlockTree::WithNeighbours(absl::Span<const std::uint64_t> marks) const {
  ISOSCOPE_CHECK_EQ(marks.size(), words_.size());
  std::vector<std::uint64_t> grown(words_.size());
  const auto add = [&](const math::Index3& brick, std::uint64_t blocks) {
    if (blocks == 0 || brick.x < 0 || brick.y < 0 || brick.z < 0 || brick.x >= brick_dims_.x ||
        brick.y >= brick_dims_.y || brick.z >= brick_dims_.z) {
      return;
    }
    const std::uint32_t cell = cells_[static_cast<std::size_t>(
        brick.x + brick_dims_.x * (brick.y + brick_dims_.y * brick.z))];
    if (cell < kEmpty) {
      grown[cell] |= blocks & words_[cell];
    }
  };
  for (std::size_t i = 0; i < marks.size(); ++i) {
    if (marks[i] == 0) {
      continue;
    }
    const math::Index3 begin = IndexOf(bricks_[i], 0);
    const math::Index3 brick{begin.x / kBrickSide, begin.y / kBrickSide, begin.z / kBrickSide};
    const Spread along_x = SpreadAlong(0, marks[i]);
    for (int x = 0; x < 3; ++x) {
      const Spread along_y = SpreadAlong(1, along_x.parts[x]);
      for (int y = 0; y < 3; ++y) {
        const Spread along_z = SpreadAlong(2, along_y.parts[y]);
        for (int z = 0; z < 3; ++z) {
          add({brick.x + x - 1, brick.y + y - 1, brick.z + z - 1}, along_z.parts[z]);
        }
      }
    }
  }
  return grown;
}

BlockSet BlockTree::ToSet() const {
  BlockSet set(math::Volume(block_dims_));
  set.InsertAll(Ids());
  return set;
}

}  // namespace isoscope::volume
