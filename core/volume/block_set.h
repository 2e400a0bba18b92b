// Sets of blocks of one volume, and ranks in them.

#ifndef ISOSCOPE_CORE_VOLUME_BLOCK_SET_H_
#define ISOSCOPE_CORE_VOLUME_BLOCK_SET_H_

#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "absl/types/span.h"

#include "core/volume/block_layout.h"

namespace isoscope::volume {

// A set of blocks: one bit for each block of the volume. Thread-compatible.
class BlockSet {
 public:
  BlockSet() = default;
  explicit BlockSet(std::int64_t block_count)
      : words_(static_cast<std::size_t>((block_count + 63) / 64)) {}
  // REQUIRES: every id is below block_count.
  BlockSet(std::int64_t block_count, absl::Span<const BlockId> ids) : BlockSet(block_count) {
    InsertAll(ids);
  }

  void Insert(BlockId id) { words_[id / 64] |= std::uint64_t{1} << (id % 64); }
  void InsertAll(absl::Span<const BlockId> ids) {
    for (const BlockId id : ids) {
      Insert(id);
    }
  }
  // Removes the blocks of [begin, end). REQUIRES: 0 <= begin <= end <= the volume's blocks.
  void EraseRange(std::int64_t begin, std::int64_t end);
  [[nodiscard]] bool Contains(BlockId id) const { return (words_[id / 64] >> (id % 64) & 1) != 0; }
  [[nodiscard]] std::int64_t Count() const;
  // Returns the members, ascending.
  [[nodiscard]] std::vector<BlockId> Ids() const;
  // REQUIRES for both: `other` is a set of blocks of the same volume.
  void UnionWith(const BlockSet& other);
  void IntersectWith(const BlockSet& other);

  // Block id is bit id % 64 of word id / 64. Bits past the last block must stay 0.
  [[nodiscard]] absl::Span<const std::uint64_t> words() const { return words_; }
  [[nodiscard]] absl::Span<std::uint64_t> words() { return absl::MakeSpan(words_); }

  friend bool operator==(const BlockSet&, const BlockSet&) = default;

 private:
  std::vector<std::uint64_t> words_;
};

// Turns the block ids of a set into ranks. Immutable; thread-safe.
class BlockRanks {
 public:
  // O(blocks of the volume / 64). `blocks` must outlive it, unchanged.
  explicit BlockRanks(const BlockSet& blocks);

  // Returns how many members are less than `id`. REQUIRES: the set contains `id`. O(1).
  [[nodiscard]] std::size_t RankOf(BlockId id) const {
    const std::uint64_t before = words_[id / 64] & ((std::uint64_t{1} << (id % 64)) - 1);
    return ranks_[id / 64] + static_cast<std::size_t>(std::popcount(before));
  }
  // The number of members.
  [[nodiscard]] std::size_t count() const { return count_; }

 private:
  absl::Span<const std::uint64_t> words_;
  std::vector<std::uint32_t> ranks_;  // of the first block of each word
  std::size_t count_ = 0;
};

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_BLOCK_SET_H_
