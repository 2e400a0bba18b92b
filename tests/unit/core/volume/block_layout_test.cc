#include "core/volume/block_layout.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "core/volume/block_samples.h"
#include "tests/support/status_matchers.h"

namespace isoscope::volume {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

struct Case {
  math::Index3 sample_dims;
  math::Index3 block_cells;
};

std::vector<Case> MakeCases() {
  std::vector<Case> cases{{{2, 2, 2}, {1, 1, 1}},   {{2, 2, 2}, {128, 128, 128}},
                          {{17, 9, 10}, {8, 8, 8}}, {{18, 10, 9}, {8, 4, 3}},
                          {{33, 2, 5}, {32, 1, 2}}, {{9, 9, 9}, {4, 4, 4}}};
  for (std::uint64_t i = 0; i < 40; ++i) {
    const auto pick = [&](std::uint64_t k, std::int64_t low, std::uint64_t count) {
      return low + static_cast<std::int64_t>(base::RandomBits(1, 6 * i + k) % count);
    };
    cases.push_back({{pick(0, 2, 20), pick(1, 2, 20), pick(2, 2, 20)},
                     {pick(3, 1, 12), pick(4, 1, 12), pick(5, 1, 12)}});
  }
  return cases;
}

TEST(BlockLayoutTest, CellsOfBlocksTileTheVolume) {
  for (const Case& c : MakeCases()) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BlockLayout layout,
                                  BlockLayout::Make(c.sample_dims, c.block_cells));
    const math::Index3 cells = c.sample_dims - math::Index3{1, 1, 1};
    std::vector<int> owners(static_cast<std::size_t>(math::Volume(cells)));
    for (std::int64_t i = 0; i < layout.block_count(); ++i) {
      const math::IndexBox box = layout.CellsOf(static_cast<BlockId>(i));
      ASSERT_GT(math::Volume(box.dims()), 0);
      for (std::int64_t z = box.begin.z; z < box.end.z; ++z) {
        for (std::int64_t y = box.begin.y; y < box.end.y; ++y) {
          for (std::int64_t x = box.begin.x; x < box.end.x; ++x) {
            ++owners.at(static_cast<std::size_t>(x + cells.x * (y + cells.y * z)));
          }
        }
      }
    }
    EXPECT_TRUE(std::all_of(owners.begin(), owners.end(), [](int n) { return n == 1; }));
  }
}

TEST(BlockLayoutTest, IdsRoundTripAndRunXFastest) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BlockLayout layout,
                                BlockLayout::Make({20, 30, 40}, {4, 5, 6}));
  BlockId expected = 0;
  for (std::int64_t z = 0; z < layout.block_dims().z; ++z) {
    for (std::int64_t y = 0; y < layout.block_dims().y; ++y) {
      for (std::int64_t x = 0; x < layout.block_dims().x; ++x, ++expected) {
        EXPECT_EQ(layout.IdOf({x, y, z}), expected);
        EXPECT_EQ(layout.IndexOf(expected), (math::Index3{x, y, z}));
      }
    }
  }
  EXPECT_EQ(expected, layout.block_count());
}

TEST(BlockLayoutTest, StoredSamplesAreOwnSamplesPlusOneLayerInsideTheVolume) {
  for (const Case& c : MakeCases()) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BlockLayout layout,
                                  BlockLayout::Make(c.sample_dims, c.block_cells));
    for (std::int64_t i = 0; i < layout.block_count(); ++i) {
      const auto id = static_cast<BlockId>(i);
      const math::IndexBox cells = layout.CellsOf(id);
      const math::IndexBox own = layout.OwnSamplesOf(id);
      const math::IndexBox stored = layout.StoredSamplesOf(id);
      for (int axis = 0; axis < 3; ++axis) {
        EXPECT_EQ(own.begin[axis], cells.begin[axis]);
        EXPECT_EQ(own.end[axis], cells.end[axis] + 1);
        EXPECT_EQ(stored.begin[axis], own.begin[axis] == 0 ? 0 : own.begin[axis] - 1);
        EXPECT_EQ(stored.end[axis],
                  own.end[axis] == c.sample_dims[axis] ? c.sample_dims[axis] : own.end[axis] + 1);
      }
      EXPECT_EQ(StoredSizeBytes(layout, id, ScalarType::kFloat32),
                4 * static_cast<std::size_t>(math::Volume(stored.dims())));
    }
  }
}

TEST(BlockLayoutTest, RefusesWhatItCannotCut) {
  EXPECT_THAT(BlockLayout::Make({1, 2, 2}, {8, 8, 8}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("1 x 2 x 2")));
  EXPECT_THAT(BlockLayout::Make({9, 9, 9}, {8, 0, 8}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("8 x 0 x 8")));
  EXPECT_THAT(BlockLayout::Make({9, 9, 9}, {8, 8, 129}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("1 to 128")));
  EXPECT_THAT(BlockLayout::Make({4096, 4096, 4096}, {1, 1, 1}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("use larger blocks")));
}

TEST(DefaultBlockCellsTest, LargeVolumesHaveLargeBlocks) {
  constexpr math::Index3 kSmall{8, 8, 8};
  constexpr math::Index3 kMiddle{12, 12, 12};
  constexpr math::Index3 kLarge{16, 16, 16};
  EXPECT_EQ(DefaultBlockCells({2, 2, 2}), kSmall);
  EXPECT_EQ(DefaultBlockCells({256, 256, 256}), kSmall);
  EXPECT_EQ(DefaultBlockCells({512, 512, 234}), kMiddle);
  EXPECT_EQ(DefaultBlockCells({512, 512, 512}), kLarge);
  EXPECT_EQ(DefaultBlockCells({1296, 1296, 1296}), kLarge);
  // 32 x 32 x 32 blocks of 16 cells are enough, and one layer less is not.
  EXPECT_EQ(DefaultBlockCells({498, 498, 498}), kLarge);
  EXPECT_EQ(DefaultBlockCells({497, 498, 498}), kMiddle);
  EXPECT_EQ(DefaultBlockCells({374, 374, 374}), kMiddle);
  EXPECT_EQ(DefaultBlockCells({373, 374, 374}), kSmall);
  // One long axis is enough, even if the product of the axes exceeds 64 bits.
  EXPECT_EQ(DefaultBlockCells({2, 524290, 2}), kLarge);
  EXPECT_EQ(DefaultBlockCells({2, 524288, 2}), kLarge);
  EXPECT_EQ(DefaultBlockCells({2, 16 * 32767 + 1, 2}), kMiddle);
  EXPECT_EQ(DefaultBlockCells({2, 12 * 32767 + 1, 2}), kSmall);
  constexpr std::int64_t kHuge = std::int64_t{1} << 40;
  EXPECT_EQ(DefaultBlockCells({kHuge, kHuge, kHuge}), kLarge);
}

}  // namespace
}  // namespace isoscope::volume
