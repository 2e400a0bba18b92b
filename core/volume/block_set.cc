#include "core/volume/block_set.h"

#include <algorithm>

#include "core/base/check.h"

namespace isoscope::volume {

std::int64_t BlockSet::Count() const {
  std::int64_t count = 0;
  for (const std::uint64_t word : words_) {
    count += std::popcount(word);
  }
  return count;
}

std::vector<BlockId> BlockSet::Ids() const {
  std::vector<BlockId> ids;
  ids.reserve(static_cast<std::size_t>(Count()));
  for (std::size_t i = 0; i < words_.size(); ++i) {
    for (std::uint64_t word = words_[i]; word != 0; word &= word - 1) {
      ids.push_back(
          static_cast<BlockId>(i * 64 + static_cast<std::size_t>(std::countr_zero(word))));
    }
  }
  return ids;
}

void BlockSet::UnionWith(const BlockSet& other) {
  ISOSCOPE_CHECK_EQ(words_.size(), other.words_.size());
  for (std::size_t i = 0; i < words_.size(); ++i) {
    words_[i] |= other.words_[i];
  }
}

void BlockSet::IntersectWith(const BlockSet& other) {
  ISOSCOPE_CHECK_EQ(words_.size(), other.words_.size());
  for (std::size_t i = 0; i < words_.size(); ++i) {
    words_[i] &= other.words_[i];
  }
}

void BlockSet::EraseRange(std::int64_t begin, std::int64_t end) {
  while (begin < end) {
    const std::int64_t word_end = std::min(end, (begin / 64 + 1) * 64);
    const std::uint64_t bits = ~std::uint64_t{0} >> (64 - (word_end - begin)) << (begin % 64);
    words_[static_cast<std::size_t>(begin / 64)] &= ~bits;
    begin = word_end;
  }
}

BlockRanks::BlockRanks(const BlockSet& blocks) : words_(blocks.words()) {
  ranks_.reserve(words_.size());
  for (const std::uint64_t word : words_) {
    ranks_.push_back(static_cast<std::uint32_t>(count_));
    count_ += static_cast<std::size_t>(std::popcount(word));
  }
}

}  // namespace isoscope::volume
