#include "core/formats/zarr/cf_arrays.h"

#include <cstdint>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/unit/core/formats/zarr/zarr_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::NumberText;
using ::isoscope::testing::Objects;
using ::isoscope::testing::OpenObjects;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::Zarr2Text;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

Objects Store() {
  return {{".zgroup", "{\"zarr_format\": 2}"},
          {"t/.zarray", Zarr2Text({2, 3, 4}, {2, 3, 4}, "<f4")},
          {"t/.zattrs", R"({"_ARRAY_DIMENSIONS": ["z", "lat", "x"], "coordinates": "lon"})"},
          {"z/.zarray", Zarr2Text({2}, {2}, "<i2")},
          {"z/.zattrs", R"({"_ARRAY_DIMENSIONS": ["z"], "units": "m", "scale_factor": 0.5,
                            "positive": "up"})"},
          {"z/0", NumberText<std::int16_t>({2, 3})},
          {"lat/.zarray", Zarr2Text({3}, {2}, ">f4")},
          {"lat/.zattrs", R"({"_ARRAY_DIMENSIONS": ["lat"], "units": "degrees_north"})"},
          {"lat/0", testing::Swapped(NumberText<float>({40, 41}), 4)},
          {"lat/1", testing::Swapped(NumberText<float>({42, 0}), 4)},
          {"lon/.zarray", Zarr2Text({4}, {4}, "<f8")},
          {"lon/.zattrs", R"({"_ARRAY_DIMENSIONS": ["x"], "standard_name": "longitude"})"},
          {"lon/0", NumberText<double>({5, 6, 7, 8})}};
}

absl::StatusOr<CfArray> Describe(const Objects& objects) {
  auto store = OpenObjects(objects);
  if (!store.ok()) {
    return store.status();
  }
  auto node = (*store)->Node("t");
  return node.ok() ? DescribeCfArray(store->get(), "", *node->array) : node.status();
}

TEST(CfArraysTest, ReadsCoordinates) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CfArray described, Describe(Store()));
  ASSERT_EQ(described.axes.size(), 3U);
  EXPECT_THAT(described.axes[0].values, ElementsAre(1, 1.5));
  EXPECT_EQ(described.axes[0].positive, "up");
  EXPECT_THAT(described.axes[1].values, ElementsAre(40, 41, 42));
  EXPECT_TRUE(described.axes[1].is_single);
  EXPECT_EQ(CfLetterOf(described.axes[1]), 'Y');
  // Named by the attribute "coordinates".
  EXPECT_THAT(described.axes[2].values, ElementsAre(5, 6, 7, 8));
  EXPECT_EQ(described.axes[2].name, "lon");
  EXPECT_THAT(described.coordinates, ElementsAre("z", "lat", "lon"));
}

TEST(CfArraysTest, ReadsTimesOfNumpy) {
  const struct {
    const char* dtype;
    const char* units;
    std::vector<double> values;
  } kTimes[] = {{"<M8[ns]", "seconds since 1970-01-01", {1.5, 2e9}},
                {"<M8[D]", "days since 1970-01-01", {1.5e9, 2e18}},
                {"<m8[5s]", "seconds", {7.5e9, 1e19}},
                {"<m8[W]", "days", {1.05e10, 1.4e19}}};
  for (const auto& time : kTimes) {
    SCOPED_TRACE(time.dtype);
    Objects objects = Store();
    objects["z/.zarray"] =
        Zarr2Text({2}, {2}, time.dtype, ", \"fill_value\": -9223372036854775808");
    objects["z/.zattrs"] = R"({"_ARRAY_DIMENSIONS": ["z"]})";
    objects["z/0"] = NumberText<std::int64_t>({1500000000, 2000000000000000000});
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CfArray described, Describe(objects));
    EXPECT_EQ(described.axes[0].fault, "");
    EXPECT_THAT(described.axes[0].values, ::testing::ElementsAreArray(time.values));
    EXPECT_EQ(described.axes[0].units, time.units);
    EXPECT_EQ(CfLetterOf(described.axes[0]), 'T');
    objects.erase("z/0");  // all are no time
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CfArray none, Describe(objects));
    EXPECT_THAT(none.axes[0].values, ::testing::Each(::testing::IsNan()));
  }
}

TEST(CfArraysTest, SaysWhatIsWrongWithCoordinates) {
  Objects text = Store();
  text["z/.zarray"] = Zarr2Text({2}, {2}, "<U4");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CfArray unread, Describe(text));
  EXPECT_THAT(unread.axes[0].fault, HasSubstr("can't be read"));
  EXPECT_THAT(unread.axes[0].values, IsEmpty());

  Objects curved = Store();
  curved.erase("lat/.zarray");
  curved["lon/.zarray"] = Zarr2Text({3, 4}, {3, 4}, "<f8");
  curved["lon/.zattrs"] = R"({"_ARRAY_DIMENSIONS": ["lat", "x"], "units": "degrees_east"})";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CfArray described, Describe(curved));
  EXPECT_THAT(described.axes[1].fault, HasSubstr("curved"));
  EXPECT_THAT(described.axes[2].fault, HasSubstr("curved"));

  // An axis of another length is none of its coordinates.
  Objects longer = Store();
  longer["z/.zarray"] = Zarr2Text({3}, {3}, "<i2");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CfArray other, Describe(longer));
  EXPECT_THAT(other.axes[0].values, IsEmpty());

  Objects cut = Store();
  cut["lat/1"] = "abc";
  EXPECT_THAT(Describe(cut), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("lat/1")));
}

}  // namespace
}  // namespace isoscope::source
