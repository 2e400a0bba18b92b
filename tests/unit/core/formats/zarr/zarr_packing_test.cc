#include "core/formats/zarr/zarr_packing.h"

#include <cmath>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/unit/core/formats/zarr/zarr_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

ZarrArray Array(NumberType type, const std::string& attributes, const ZarrJson& fill = nullptr,
                bool has_names = true) {
  ZarrArray array;
  array.type = type;
  array.attributes = ZarrJson::parse(attributes);
  array.has_fill = !fill.is_null();
  array.fill = array.has_fill ? *NumberBytes(fill, type) : std::string(SizeOf(type), '\0');
  if (has_names) {
    array.dimension_names = {"z", "y", "x"};
  }
  return array;
}

TEST(ZarrPackingTest, ScalesAndMarksMissingValues) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const ZarrPacking packing,
      ZarrPackingOf(Array(NumberType::kInt16,
                          R"({"scale_factor": 0.5, "add_offset": 10, "missing_value": -9,
                              "valid_max": 100})",
                          -32768)));
  EXPECT_FALSE(packing.is_plain());
  EXPECT_THAT(packing.missing, ElementsAre(-9));
  const std::string stored = testing::NumberText<std::int16_t>({4, -9, 101, -2});
  std::string out(16, '\0');
  ASSERT_EQ(UnpackedType(NumberType::kInt16), volume::ScalarType::kFloat32);
  UnpackZarr(packing, NumberType::kInt16, 4, stored.data(), out.data());
  const auto values = testing::NumbersIn<float>(out);
  EXPECT_EQ(values[0], 12);
  EXPECT_TRUE(std::isnan(values[1]));
  EXPECT_TRUE(std::isnan(values[2]));
  EXPECT_EQ(values[3], 9);
}

// xarray writes _FillValue as the fill value of the array.
TEST(ZarrPackingTest, TakesTheFillValueWhereXarrayWritesIt) {
  const auto missing = [](const ZarrArray& array) { return ZarrPackingOf(array)->missing; };
  EXPECT_THAT(missing(Array(NumberType::kInt16, R"({"scale_factor": 2})", -32768)),
              ElementsAre(-32768));
  EXPECT_THAT(missing(Array(NumberType::kFloat32, "{}", -9999)), ElementsAre(-9999));
  EXPECT_THAT(missing(Array(NumberType::kFloat32, "{}", 0)), IsEmpty());
  EXPECT_THAT(missing(Array(NumberType::kFloat32, "{}", "NaN")), IsEmpty());
  EXPECT_THAT(missing(Array(NumberType::kUint8, "{}", 255)), IsEmpty());
  EXPECT_THAT(missing(Array(NumberType::kFloat32, "{}", -9999, false)), IsEmpty());
  EXPECT_THAT(missing(Array(NumberType::kInt16, R"({"_FillValue": 7})", 3)), ElementsAre(7));
  // Zarr 3: in base64, of a double.
  EXPECT_THAT(missing(Array(NumberType::kFloat32, R"({"_FillValue": "AAAAAAAA+H8="})", 0)),
              IsEmpty());
  EXPECT_THAT(missing(Array(NumberType::kFloat32, R"({"_FillValue": "AAAAAACHw8A="})", 0)),
              ElementsAre(-9998.0));
}

TEST(ZarrPackingTest, RefusesAttributesThatMakeNoSense) {
  for (const char* bad :
       {R"({"scale_factor": 0})", R"({"scale_factor": "2"})", R"({"add_offset": [1, 2]})",
        R"({"valid_min": 3, "valid_max": 1})", R"({"scale_factor": "NaN"})"}) {
    EXPECT_THAT(ZarrPackingOf(Array(NumberType::kInt16, bad)),
                StatusIs(absl::StatusCode::kInvalidArgument))
        << bad;
  }
  EXPECT_THAT(ZarrPackingOf(Array(NumberType::kFloat16, R"({"scale_factor": 2})")),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("float16")));
}

}  // namespace
}  // namespace isoscope::source
