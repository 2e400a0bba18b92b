#include "core/volume/block_set.h"

#include <cstddef>
#include <cstdint>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/random.h"

namespace isoscope::volume {
namespace {

TEST(BlockSetTest, IdsAreTheMembersAscending) {
  BlockSet blocks(200);
  EXPECT_THAT(blocks.Ids(), ::testing::IsEmpty());
  for (const BlockId id : {199U, 0U, 64U, 63U, 128U, 64U}) {
    blocks.Insert(id);
  }
  EXPECT_THAT(blocks.Ids(), ::testing::ElementsAre(0, 63, 64, 128, 199));
  EXPECT_EQ(blocks.Count(), 5);
}

TEST(BlockSetTest, UnionAndIntersectionAreThoseOfTheMembers) {
  BlockSet a(130);
  BlockSet b(130);
  for (std::int64_t id = 0; id < 130; ++id) {
    if (id % 2 == 0) {
      a.Insert(static_cast<BlockId>(id));
    }
    if (id % 3 == 0) {
      b.Insert(static_cast<BlockId>(id));
    }
  }
  BlockSet either = a;
  either.UnionWith(b);
  BlockSet both = a;
  both.IntersectWith(b);
  for (std::int64_t id = 0; id < 130; ++id) {
    EXPECT_EQ(either.Contains(static_cast<BlockId>(id)), id % 2 == 0 || id % 3 == 0) << id;
    EXPECT_EQ(both.Contains(static_cast<BlockId>(id)), id % 6 == 0) << id;
  }
}

TEST(BlockSetTest, ARangeIsErasedAndNothingElse) {
  for (const std::int64_t begin : {0, 1, 63, 64, 65, 130, 199, 200}) {
    for (const std::int64_t end : {0, 1, 63, 64, 65, 128, 129, 199, 200}) {
      if (begin > end) {
        continue;
      }
      BlockSet blocks(200);
      std::vector<BlockId> expected;
      for (std::int64_t id = 0; id < 200; ++id) {
        blocks.Insert(static_cast<BlockId>(id));
        if (id < begin || id >= end) {
          expected.push_back(static_cast<BlockId>(id));
        }
      }
      blocks.EraseRange(begin, end);
      EXPECT_EQ(blocks.Ids(), expected) << begin << " to " << end;
      EXPECT_EQ(blocks, BlockSet(200, expected));
    }
  }
}

TEST(BlockSetDeathTest, SetsOfOtherVolumesAreRefused) {
  BlockSet blocks(64);
  EXPECT_DEATH(blocks.UnionWith(BlockSet(65)), "words_.size");
  EXPECT_DEATH(blocks.IntersectWith(BlockSet(65)), "words_.size");
}

TEST(BlockRanksTest, EveryMemberHasItsPlaceInTheListOfIds) {
  for (const std::int64_t block_count : {1, 64, 65, 1000, 4096}) {
    BlockSet blocks(block_count);
    for (std::int64_t id = 0; id < block_count; ++id) {
      if (base::RandomUnit(5, static_cast<std::uint64_t>(id)) < 0.4 || id == block_count - 1) {
        blocks.Insert(static_cast<BlockId>(id));
      }
    }
    const std::vector<BlockId> ids = blocks.Ids();
    const BlockRanks ranks(blocks);
    EXPECT_EQ(ranks.count(), ids.size());
    for (std::size_t place = 0; place < ids.size(); ++place) {
      EXPECT_EQ(ranks.RankOf(ids[place]), place) << block_count;
    }
  }
}

}  // namespace
}  // namespace isoscope::volume
