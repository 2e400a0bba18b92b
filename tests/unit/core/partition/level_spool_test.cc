#include "core/partition/level_spool.h"

#include <string>
#include <vector>

#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/partition/level_fixture.h"
#include "tests/unit/core/partition/partitioner_fixture.h"

namespace isoscope::partition {
namespace {

using ::isoscope::testing::Noise;
using volume::LevelFilter;
using volume::ScalarType;

std::string ReadAll(source::VolumeSource* source) {
  const math::Index3& dims = source->info().geometry.sample_dims;
  std::string bytes(static_cast<std::size_t>(source->info().row_bytes() * dims.y * dims.z), '\0');
  EXPECT_THAT(source->ReadRows(0, dims.y * dims.z, bytes.data()), testing::IsOk());
  return bytes;
}

// Blocks with odd and even edges; portions of one layer and one row of blocks, last to first.
TEST(LevelSpoolTest, EverySampleIsMadeInOnePortionWhateverTheBlocksAndTheOrder) {
  const testing::TempDir dir;
  const math::Index3 dims{19, 22, 17};
  const Volume v{dims, ScalarType::kInt16, Noise(dims, ScalarType::kInt16)};
  const Volume expected = Reduced(v, ScalarType::kInt16, LevelFilter::kMean);
  const volume::VolumeLevel level = volume::LevelOf(GeometryOf(v), v.type, LevelFilter::kMean, 1);
  for (const math::Index3& cells :
       {math::Index3{1, 1, 1}, math::Index3{5, 3, 7}, math::Index3{4, 4, 2}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto layout, volume::BlockLayout::Make(dims, cells));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto spool, LevelSpool::Create(dir.path(), level, v.type, LevelFilter::kMean));
    PartitionPlan plan;
    plan.layers_per_portion = 1;
    plan.block_rows_per_portion = 1;
    for (std::int64_t i = PortionCount(layout, plan); i-- > 0;) {
      const Portion portion = PortionAt(layout, plan, i);
      math::IndexBox box = SamplesOfPortion(layout, portion);
      const std::string slab = ExpectedBlock(v, box);
      ISOSCOPE_ASSERT_OK(spool->Add(layout,
                                    {.samples = slab.data(),
                                     .begin_z = box.begin.z,
                                     .begin_y = box.begin.y,
                                     .rows = box.end.y - box.begin.y},
                                    portion));
    }
    const auto source = spool->MakeSource("level");
    EXPECT_EQ(source->info().geometry, level.grid);
    EXPECT_EQ(source->info().type, level.type);
    EXPECT_TRUE(ReadAll(source.get()) == expected.samples) << cells.x;
  }
}

// A row of the level that is longer than the buffer is made in pieces.
TEST(LevelSpoolTest, LongRowsAreMadeInPieces) {
  const testing::TempDir dir;
  const math::Index3 dims{600'000, 2, 2};
  const Volume v{dims, ScalarType::kFloat64, Noise(dims, ScalarType::kFloat64)};
  volume::VolumeLevel level;
  level.index = 1;
  level.grid.sample_dims = {300'000, 1, 1};  // no level has so few; the spool does not mind
  level.type = v.type;
  ASSERT_LT(LevelSpool::MemoryBytes(level), 300'000 * 8);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto layout, volume::BlockLayout::Make(dims, {128, 1, 1}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto spool,
                                LevelSpool::Create(dir.path(), level, v.type, LevelFilter::kMean));
  ISOSCOPE_ASSERT_OK(spool->Add(layout, {.samples = v.samples.data()},
                                {.begin_layer = 0, .end_layer = 1, .begin_row = 0, .end_row = 1}));
  const Volume expected = Reduced(v, v.type, LevelFilter::kMean);
  EXPECT_TRUE(ReadAll(spool->MakeSource("level").get()) == expected.samples);
}

}  // namespace
}  // namespace isoscope::partition
