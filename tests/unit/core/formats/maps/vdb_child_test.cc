// The calls of the module, in this process: that hostile bytes may crash them is the concern of
// vdb_series_test.cc.

#include "core/formats/maps/vdb_child.h"

#include <malloc.h>

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/vdb_file.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::VdbFileGrid;
using ::testing::HasSubstr;

TEST(VdbChildTest, ListsTypesClassesAndTransforms) {
  const testing::TempDir dir;
  VdbFileGrid scaled{.name = "c"};
  scaled.world[0][0] = 2;
  testing::WriteVdbFile(dir.Sub("a.vdb"), {{.name = "a", .is_level_set = true},
                                           {.name = "b", .type = "vec3f"},
                                           scaled,
                                           {.name = "d", .type = "points"},
                                           {.name = "e", .is_frustum = true}});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto grids, VdbCalls().list(dir.Sub("a.vdb")));
  ASSERT_EQ(grids.size(), 5);
  EXPECT_EQ(grids[0].name, "a");
  EXPECT_EQ(grids[0].type, "Tree_float_5_4_3");
  EXPECT_EQ(grids[0].grid_class, "level set");
  EXPECT_EQ(grids[0].components, 1);
  EXPECT_TRUE(grids[0].is_linear);
  EXPECT_EQ(grids[1].components, 3);
  EXPECT_EQ(grids[1].alike, 0);
  EXPECT_EQ(grids[2].alike, 2);
  EXPECT_EQ(grids[3].components, 0);
  EXPECT_THAT(grids[3].type, HasSubstr("ptdata"));
  EXPECT_FALSE(grids[4].is_linear);
}

TEST(VdbChildTest, ErrorsNameTheFile) {
  const testing::TempDir dir;
  testing::WriteFile(dir.Sub("a.vdb"), "no such thing");
  EXPECT_THAT(VdbCalls().list(dir.Sub("a.vdb")),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("a.vdb: OpenVDB can't read it")));
  testing::WriteVdbFile(dir.Sub("b.vdb"),
                        {{.fills = {{.begin = {0, 0, 0}, .end = {2, 2, 2}, .value = 1}}}});
  EXPECT_THAT(VdbCalls().open(dir.Sub("b.vdb"), 1, 0, false),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no grid 1")));
  EXPECT_THAT(VdbCalls().open(dir.Sub("b.vdb"), 0, 1, false),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no component 1")));
}

std::int64_t HeapBytes() {
  const auto heap = ::mallinfo2();
  return static_cast<std::int64_t>(heap.uordblks + heap.hblkhd);
}

TEST(VdbChildTest, ADenseGridIsReadInAnyOrderWithTheTreeAndOneLayerInMemory) {
  constexpr std::int64_t kSide = 256;
  constexpr std::int64_t kPlanes = 64;
  constexpr std::int64_t kRowBytes = kSide * 4;
  const testing::TempDir dir;
  const VdbFileGrid grid{
      .fills = {{.begin = {0, 0, 0}, .end = {kSide, kSide, kPlanes}, .has_pattern = true}}};
  testing::WriteVdbFile(dir.Sub("a.vdb"), {grid});
  std::vector<char> plane(kSide * kRowBytes);
  const std::int64_t before = HeapBytes();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, VdbCalls().open(dir.Sub("a.vdb"), 0, 0, false));
  const std::int64_t stated = volume->header().memory_bytes;
  EXPECT_LT(stated, kPlanes * kSide * kRowBytes / 2);
  const auto expect_rows = [&](std::int64_t begin_row, std::int64_t end_row) {
    ISOSCOPE_ASSERT_OK(volume->ReadRows(begin_row, end_row, plane.data()));
    EXPECT_LE(HeapBytes() - before, stated);
    for (std::int64_t row = begin_row; row < end_row; ++row) {
      for (std::int64_t x = 0; x < kSide; ++x) {
        float read = 0;
        std::memcpy(&read, plane.data() + (row - begin_row) * kRowBytes + x * 4, sizeof(read));
        ASSERT_EQ(read, testing::VdbVoxelAt(grid, {x, row % kSide, row / kSide}, 0).value)
            << x << " in row " << row;
      }
    }
  };
  for (std::int64_t z = 0; z < kPlanes; ++z) {
    expect_rows(z * kSide, (z + 1) * kSide);
  }
  expect_rows(20 * kSide + 3, 20 * kSide + 5);
  expect_rows(3 * kSide + 60, 4 * kSide + 7);
  expect_rows(60 * kSide, 61 * kSide);
}

}  // namespace
}  // namespace isoscope::source
