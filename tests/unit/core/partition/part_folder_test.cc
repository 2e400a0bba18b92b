#include "core/partition/part_folder.h"

#include <algorithm>
#include <cstdint>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/io/file.h"
#include "core/store/block_order.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::partition {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

volume::BlockLayout LayoutOf(std::int64_t planes, std::int64_t cells) {
  return *volume::BlockLayout::Make({9, 9, planes}, {4, 4, cells});
}

TEST(PartSlabsTest, PartsHaveEachLayerOnceAndBeginBetweenCubes) {
  for (const std::int64_t planes : {2, 9, 33, 34, 200}) {
    for (const std::int64_t cells : {1, 3, 16}) {
      const volume::BlockLayout layout = LayoutOf(planes, cells);
      for (const int count : {1, 2, 3, 7, 50}) {
        std::int64_t end = 0;
        std::int64_t largest = 0;
        std::int64_t smallest = layout.block_dims().z;
        for (int index = 0; index < count; ++index) {
          const LayerRange layers = LayersOfPart(layout, {.index = index, .count = count});
          EXPECT_EQ(layers.begin, end);
          EXPECT_GE(layers.end, layers.begin);
          EXPECT_TRUE(layers.begin % store::kCubeEdge == 0 ||
                      layers.begin == layout.block_dims().z);
          end = layers.end;
          largest = std::max(largest, layers.end - layers.begin);
          smallest = std::min(smallest, layers.end - layers.begin);
        }
        EXPECT_EQ(end, layout.block_dims().z);
        EXPECT_LE(largest - smallest, 2 * store::kCubeEdge);
      }
    }
  }
}

TEST(PartSlabsTest, PortionsOfSlabsAreThoseOfTheVolume) {
  const volume::BlockLayout layout = LayoutOf(70, 3);
  for (const std::int64_t layers_per_portion : {1, 2, 4}) {
    for (const std::int64_t rows : {1, 2, 3}) {
      PartitionPlan plan;
      plan.layers_per_portion = layers_per_portion;
      plan.block_rows_per_portion = rows;
      std::int64_t next = 0;
      for (int index = 0; index < 4; ++index) {
        const LayerRange layers = LayersOfPart(layout, {.index = index, .count = 4});
        const PortionRange portions = PortionsOf(layout, plan, layers);
        EXPECT_EQ(portions.begin, next);
        for (std::int64_t i = portions.begin; i < portions.end; ++i) {
          const Portion portion = PortionAt(layout, plan, i);
          EXPECT_GE(portion.begin_layer, layers.begin);
          EXPECT_LE(portion.end_layer, layers.end);
        }
        next = portions.end;
      }
      EXPECT_EQ(next, PortionCount(layout, plan));
    }
  }
}

class PartFolderTest : public ::testing::Test {
 protected:
  static store::PartCut CutOf(int index, int count, const std::string& shards) {
    return {.part = {.index = index, .count = count},
            .members = {{"--shards", shards}},
            .name = "d",
            .series = std::nullopt,
            .keys = {}};
  }

  testing::TempDir dir_;
};

TEST_F(PartFolderTest, TheFolderIsNamedByTheOutputOrWithItsSuffix) {
  const PartFolder folder(dir_.Sub("d"));
  EXPECT_FALSE(folder.Exists());
  ISOSCOPE_ASSERT_OK(folder.Make({"volume"}));
  ISOSCOPE_ASSERT_OK(folder.Make({"volume"}));  // another part
  EXPECT_TRUE(folder.Exists());
  for (const std::string& name :
       {dir_.Sub("d"), dir_.Sub("d/"), dir_.Sub("d.partial"), dir_.Sub("d.partial/")}) {
    EXPECT_EQ(PartFolder(name).output(), dir_.Sub("d")) << name;
  }
  ISOSCOPE_ASSERT_OK(folder.Remove());
  EXPECT_FALSE(io::PathExists(folder.path()));
}

TEST_F(PartFolderTest, TheWorkOfARunWithoutPartsIsLeftAlone) {
  const PartFolder folder(dir_.Sub("d"));
  ISOSCOPE_ASSERT_OK(io::CreateDirectory(folder.path()));
  ISOSCOPE_ASSERT_OK(io::CreateDirectory(folder.path() + "/finished"));
  EXPECT_THAT(folder.Make({"volume"}), StatusIs(absl::StatusCode::kFailedPrecondition,
                                                HasSubstr("without --part (finished)")));
  EXPECT_FALSE(folder.Exists());
  // What the message advises.
  ISOSCOPE_ASSERT_OK(io::RemoveRecursively(folder.path()));
  ISOSCOPE_EXPECT_OK(folder.Make({"volume"}));
  EXPECT_TRUE(folder.Exists());
}

TEST_F(PartFolderTest, StatesAreThoseOfAllPartsThatHaveBegun) {
  const PartFolder folder(dir_.Sub("d"));
  ISOSCOPE_ASSERT_OK(folder.Make({"volume"}));
  EXPECT_THAT(ReadPartsState(folder),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("--part 0/N")));
  ISOSCOPE_ASSERT_OK(folder.WriteCut(CutOf(2, 3, "4")));
  ISOSCOPE_ASSERT_OK(folder.WriteCut(CutOf(2, 3, "4")));
  ISOSCOPE_ASSERT_OK(folder.WriteCut(CutOf(0, 3, "4")));
  ISOSCOPE_ASSERT_OK(io::CreateDirectory(folder.PiecePath("volume", {.index = 0, .count = 3})));
  const std::string work = folder.PiecePath("volume", {.index = 2, .count = 3}) + ".try-abcdef";
  ISOSCOPE_ASSERT_OK(io::CreateDirectory(work));
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(
      work + "/progress.json",
      store::EncodePartProgress(
          {.phase = "writing blocks", .done_bytes = 1, .total_bytes = 2, .host = "node-7"})));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const PartsState state, ReadPartsState(folder));
  EXPECT_EQ(state.volume_count, 1);
  ASSERT_EQ(state.parts.size(), 3u);
  EXPECT_EQ(state.parts[0].finished_volumes, 1);
  EXPECT_FALSE(state.parts[1].has_begun);
  EXPECT_EQ(state.parts[2].finished_volumes, 0);
  ASSERT_EQ(state.parts[2].tries.size(), 1u);
  EXPECT_EQ(state.parts[2].tries[0].host, "node-7");
}

TEST_F(PartFolderTest, PartsOfOtherCutsAreNamed) {
  const PartFolder folder(dir_.Sub("d"));
  EXPECT_THAT(CheckSameCut(CutOf(0, 3, "4"), CutOf(1, 3, "5"), folder),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       HasSubstr("part 0 of 3 and part 1 of 3 are not of one dataset: --shards is "
                                 "4 there and 5 here")));
  EXPECT_THAT(CheckSameCut(CutOf(0, 3, "4"), CutOf(1, 8, "4"), folder),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       HasSubstr("the number of parts is 3 there and 8 here")));
  ISOSCOPE_EXPECT_OK(CheckSameCut(CutOf(0, 3, "4"), CutOf(1, 3, "4"), folder));
}

}  // namespace
}  // namespace isoscope::partition
