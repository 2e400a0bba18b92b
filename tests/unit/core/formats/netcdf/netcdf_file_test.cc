#include "core/formats/netcdf/netcdf_file.h"

#include <cmath>
#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/status_macros.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/netcdf/netcdf_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::NetcdfWriter;
using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

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
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const NetcdfPacking packing, NetcdfFile::PackingOf(volumes[0]));
  EXPECT_EQ(packing.slope, 2);
  EXPECT_EQ(packing.intercept, 0);
  EXPECT_THAT(packing.missing, ElementsAre(NC_FILL_SHORT, -1));
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

// The packing of a variable of one byte, or of the type that is given, with these attributes.
using Attributes = std::vector<std::pair<std::string, std::vector<double>>>;  // of 64-bit floats
absl::StatusOr<NetcdfPacking> PackingWith(nc_type type, const Attributes& attributes,
                                          const NetcdfWriter::Texts& texts = {},
                                          const NetcdfWriter::Numbers& of_the_type = {}) {
  const testing::TempDir dir;
  {
    NetcdfWriter writer(dir.Sub("a.nc"), NC_NETCDF4);
    const std::vector<int> dims{writer.Dimension("z", 2), writer.Dimension("y", 2),
                                writer.Dimension("x", 2)};
    writer.Variable("p", type, dims, {2, 2, 2}, std::vector<double>(8, 1), texts, of_the_type);
    for (const auto& [name, numbers] : attributes) {
      writer.Attribute("p", name, numbers);
    }
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const auto file, NetcdfFile::Open(dir.Sub("a.nc")));
  ISOSCOPE_ASSIGN_OR_RETURN(const auto arrays, file->Arrays());
  return arrays.size() == 1 ? NetcdfFile::PackingOf(arrays[0])
                            : absl::StatusOr<NetcdfPacking>(absl::InternalError("no variable"));
}

TEST(NetcdfFileTest, PackingThatMakesNoSenseIsRefusedByName) {
  struct Case {
    Attributes attributes;
    std::string message;
  };
  for (const Case& c : std::vector<Case>{
           {{{"scale_factor", {NAN}}}, "scale_factor is nan"},
           {{{"scale_factor", {INFINITY}}}, "scale_factor is inf"},
           {{{"scale_factor", {0}}}, "scale_factor is 0"},
           {{{"scale_factor", {1, 2}}}, "scale_factor is 1, 2; expected one number"},
           {{{"add_offset", {-INFINITY}}}, "add_offset is -inf"},
           {{{"valid_min", {NAN}}}, "valid_min is nan"},
           {{{"valid_range", {5}}}, "valid_range is 5; expected two numbers"},
           {{{"valid_range", {5, 1}}}, "no sample is valid by its valid_range, from 5 to 1"},
           {{{"valid_min", {5}}, {"valid_max", {1}}},
            "by its valid_min and valid_max, from 5 to 1"},
           {{{"valid_range", {0, 5}}, {"valid_max", {3}}}, "valid_range beside valid_max"}}) {
    EXPECT_THAT(PackingWith(NC_SHORT, c.attributes),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(c.message)));
  }
  EXPECT_THAT(PackingWith(NC_SHORT, {}, {{"scale_factor", "0.01"}}),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       HasSubstr("scale_factor is the text \"0.01\"; expected one number")));
}

TEST(NetcdfFileTest, LimitsAreNumbersAndOnlyUnsignedOnesWrap) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const NetcdfPacking bytes,
      PackingWith(NC_UBYTE, {{"valid_min", {-1}}, {"valid_max", {200}}, {"missing_value", {-1}}}));
  EXPECT_EQ(bytes.valid_min, -1);
  EXPECT_EQ(bytes.valid_max, 200);
  EXPECT_THAT(bytes.missing, ElementsAre(-1)) << "no sample, and not 255";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const NetcdfPacking wrapped,
      PackingWith(NC_BYTE, {{"valid_range", {1, -2}}, {"missing_value", {-1}}},
                  {{"_Unsigned", "true"}}));
  EXPECT_EQ(wrapped.valid_min, 1);
  EXPECT_EQ(wrapped.valid_max, 254);
  EXPECT_THAT(wrapped.missing, ElementsAre(255));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const NetcdfPacking half,
                                PackingWith(NC_SHORT, {{"valid_min", {274.5}}}));
  EXPECT_EQ(half.valid_min, 274.5) << "between two integers";
}

// A limit of the type of scale_factor, if that is wider than the stored one, is a scaled value.
TEST(NetcdfFileTest, LimitsMayBeThoseOfScaledValues) {
  const Attributes scale{{"scale_factor", {0.01}}, {"add_offset", {273.15}}};
  Attributes both = scale;
  both.emplace_back("valid_range", std::vector<double>{270, 300});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const NetcdfPacking range, PackingWith(NC_SHORT, both));
  EXPECT_EQ(range.valid_min, -315);
  EXPECT_EQ(range.valid_max, 2685);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const NetcdfPacking stored,
      PackingWith(NC_SHORT, scale, {}, {{"valid_min", 270}, {"valid_max", 300}}));
  EXPECT_EQ(stored.valid_min, 270);
  EXPECT_EQ(stored.valid_max, 300);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const NetcdfPacking turned,
      PackingWith(NC_SHORT, {{"scale_factor", {-0.5}}, {"valid_range", {-10, 20}}}));
  EXPECT_EQ(turned.valid_min, -40);
  EXPECT_EQ(turned.valid_max, 20);
}

TEST(NetcdfFileTest, WhatTheLibraryWritesWhereNobodyDidIsMissing) {
  struct Case {
    nc_type type;
    std::vector<double> missing;
  };
  for (const Case& c : std::vector<Case>{{NC_BYTE, {}},
                                         {NC_UBYTE, {}},
                                         {NC_SHORT, {-32767}},
                                         {NC_USHORT, {65535}},
                                         {NC_INT, {-2147483647}},
                                         {NC_UINT, {4294967295}},
                                         {NC_INT64, {}}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const NetcdfPacking packing, PackingWith(c.type, {}));
    EXPECT_EQ(packing.missing, c.missing) << c.type;
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const NetcdfPacking wrapped,
                                PackingWith(NC_SHORT, {}, {{"_Unsigned", "true"}}));
  EXPECT_THAT(wrapped.missing, ElementsAre(32769));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const NetcdfPacking own,
                                PackingWith(NC_SHORT, {}, {}, {{"_FillValue", 7}}));
  EXPECT_THAT(own.missing, ElementsAre(7));
}

TEST(NetcdfFileTest, CoordinatesMayHaveAnotherNameThanTheirDimension) {
  const testing::TempDir dir;
  const std::string path = dir.Sub("a.nc");
  {
    NetcdfWriter writer(path, 0);
    const std::vector<int> dims{writer.Dimension("k", 3), writer.Dimension("j", 2),
                                writer.Dimension("i", 2)};
    const std::vector<double> values(12, 1);
    writer.Variable("depth", NC_DOUBLE, {dims[0]}, {3}, {2, 7, 12},
                    {{"units", "m"}, {"positive", "down"}});
    writer.Variable("number", NC_DOUBLE, {dims[0]}, {3}, {5, 6, 8});
    writer.Variable("lat", NC_DOUBLE, {dims[1], dims[2]}, {2, 2}, {1, 2, 3, 4},
                    {{"units", "degrees_north"}});
    writer.Variable("deep", NC_FLOAT, dims, {3, 2, 2}, values, {{"coordinates", "none depth"}});
    writer.Variable("plain", NC_FLOAT, dims, {3, 2, 2}, values, {{"coordinates", "number"}});
    writer.Variable("curved", NC_FLOAT, dims, {3, 2, 2}, values, {{"coordinates", "lat depth"}});
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, NetcdfFile::Open(path));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto arrays, file->Arrays());
  ASSERT_EQ(arrays.size(), 3u);
  const CfAxis& deep = arrays[0].axes[0];
  EXPECT_THAT(deep.values, ElementsAre(2, 7, 12));
  EXPECT_EQ(deep.name, "depth");
  EXPECT_EQ(deep.positive, "down");
  EXPECT_EQ(deep.units, "m");
  EXPECT_THAT(arrays[1].axes[0].values, ElementsAre()) << "nothing says that they are positions";
  EXPECT_EQ(arrays[1].axes[0].name, "k");
  EXPECT_THAT(arrays[2].axes[0].values, ElementsAre(2, 7, 12));
  EXPECT_EQ(arrays[2].axes[0].fault, "");
  for (const std::size_t axis : {1U, 2U}) {
    EXPECT_THAT(arrays[2].axes[axis].fault,
                ::testing::AllOf(HasSubstr("\"lat\" depend on 2 axes"), HasSubstr("--spacing")));
    EXPECT_EQ(arrays[0].axes[axis].fault, "");
  }
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
