#include "core/formats/netcdf/netcdf_file.h"

#include <memory>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/netcdf/netcdf_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::NetcdfWriter;
using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;

TEST(NetcdfFileTest, FindsVolumesWithTheirAxesAndPacking) {
  const testing::TempDir dir;
  const std::string path = dir.Sub("a.nc");
  {
    NetcdfWriter writer(path, NC_NETCDF4);
    const std::vector<int> dims{writer.Dimension("z", 2), writer.Dimension("lat", 3),
                                writer.Dimension("lon", 4)};
    writer.Variable("lat", NC_SHORT, {dims[1]}, {3}, {1, 2, 3}, {{"units", "degrees_north"}},
                    {{"scale_factor", 0.5}, {"add_offset", 10}});
    writer.Variable("p", NC_SHORT, dims, {2, 3, 4}, std::vector<double>(24, 7),
                    {{"long_name", "pressure"}},
                    {{"scale_factor", 2}, {"missing_value", -1}, {"valid_max", 99}});
    writer.Variable("flat", NC_SHORT, {dims[1], dims[2]}, {3, 4}, std::vector<double>(12, 7));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, NetcdfFile::Open(path));
  EXPECT_EQ(file->path(), path);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volumes, file->Arrays());
  ASSERT_EQ(volumes.size(), 1u);
  EXPECT_EQ(volumes[0].name, "p");
  EXPECT_THAT(volumes[0].axes[1].values, ElementsAre(10.5, 11, 11.5));
  EXPECT_EQ(volumes[0].axes[1].units, "degrees_north");
  EXPECT_EQ(file->Text(volumes[0], {"units", "long_name"}), "pressure");
  const NetcdfPacking packing = file->PackingOf(volumes[0]);
  EXPECT_EQ(packing.slope, 2);
  EXPECT_EQ(packing.intercept, 0);
  EXPECT_THAT(packing.missing, ElementsAre(-1));
  EXPECT_EQ(packing.valid_min, std::nullopt);
  EXPECT_EQ(packing.valid_max, 99);
  EXPECT_FALSE(packing.is_plain());
}

TEST(NetcdfFileTest, FindsVariablesOfAnyRankWithTheirNumbers) {
  const testing::TempDir dir;
  const std::string path = dir.Sub("a.nc");
  {
    NetcdfWriter writer(path, 0);
    const int x = writer.Dimension("x", 3);
    writer.Variable("limits", NC_FLOAT, {x}, {3}, {1, 2.5, -1});
    writer.Variable("only", NC_INT, {}, {}, {7});
    writer.Attribute("only", "cosines", {0, 0.5, 1});
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, NetcdfFile::Open(path));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto limits, file->Find("limits"));
  ASSERT_TRUE(limits.has_value());
  EXPECT_EQ(limits->axes[0].size, 3);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto values, file->Values(*limits));
  EXPECT_THAT(values, ElementsAre(1, 2.5, -1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto only, file->Find("only"));
  ASSERT_TRUE(only.has_value());
  EXPECT_THAT(file->Values(*only).value(), ElementsAre(7));
  EXPECT_THAT(file->Numbers(*only, "cosines"), ElementsAre(0, 0.5, 1));
  EXPECT_THAT(file->Numbers(*only, "none"), ElementsAre());
  EXPECT_EQ(file->Find("none").value(), std::nullopt);
}

TEST(NetcdfFileTest, CoordinatesMayBeMissingOrUnsigned) {
  const testing::TempDir dir;
  const std::string path = dir.Sub("a.nc");
  {
    NetcdfWriter writer(path, 0);
    const int x = writer.Dimension("x", 3);
    const int y = writer.Dimension("y", 2);
    const int z = writer.Dimension("z", 2);
    writer.Variable("x", NC_BYTE, {x}, {3}, {100, -56, -1}, {{"_Unsigned", "true"}});
    writer.Variable("y", NC_FLOAT, {y}, {2}, {1, NC_FILL_FLOAT});
    writer.Variable("z", NC_SHORT, {z}, {2}, {-9, 4}, {}, {{"_FillValue", -9}, {"add_offset", 9}});
    writer.Variable("p", NC_BYTE, {z, y, x}, {2, 2, 3}, std::vector<double>(12, 1));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, NetcdfFile::Open(path));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto arrays, file->Arrays());
  ASSERT_EQ(arrays.size(), 1u);
  EXPECT_THAT(arrays[0].axes[2].values, ElementsAre(100, 200, 255));
  EXPECT_THAT(arrays[0].axes[1].values, ElementsAre(1, ::testing::IsNan()));
  EXPECT_THAT(arrays[0].axes[0].values, ElementsAre(::testing::IsNan(), 13));
}

TEST(NetcdfFileTest, SaysWhatIsNone) {
  const testing::TempDir dir;
  testing::WriteFile(dir.Sub("a.nc"), "text");
  EXPECT_THAT(NetcdfFile::Open(dir.Sub("a.nc")), StatusIs(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(NetcdfFile::Open(dir.Sub("none.nc")), StatusIs(absl::StatusCode::kNotFound));
  EXPECT_THAT(NetcdfFile::Open("http://localhost/a.nc"), StatusIs(absl::StatusCode::kNotFound));
}

}  // namespace
}  // namespace isoscope::source
