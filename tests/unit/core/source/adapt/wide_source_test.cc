#include "core/source/adapt/wide_source.h"

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/memory_source.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::BytesOf;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::ValuesOf;
using ::testing::AllOf;
using ::testing::HasSubstr;

template <typename T>
std::unique_ptr<VolumeSource> Wide(const std::vector<T>& values, WideType type) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {2, 2, static_cast<std::int64_t>(values.size() / 4)};
  return MakeWideSource(
      testing::MakeMemorySource(geometry, CarrierType(type), BytesOf(values), "v"), type);
}

TEST(WideSourceTest, NamesAndCarriers) {
  EXPECT_EQ(WideTypeFromName("int64"), WideType::kInt64);
  EXPECT_EQ(WideTypeFromName("uint64"), WideType::kUint64);
  EXPECT_EQ(WideTypeFromName("float16"), WideType::kFloat16);
  EXPECT_EQ(WideTypeFromName("int32"), std::nullopt);
  EXPECT_EQ(CarrierType(WideType::kFloat16), volume::ScalarType::kUint16);
}

TEST(WideSourceTest, IntegersUpTo53BitsAreExact) {
  constexpr std::int64_t kLimit = std::int64_t{1} << 53;
  const std::vector<std::int64_t> values{0,          -1,         kLimit, -kLimit,
                                         kLimit - 1, 1 - kLimit, 7,      1LL << 40};
  const auto source = Wide(values, WideType::kInt64);
  EXPECT_EQ(source->info().type, volume::ScalarType::kFloat64);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, 1));
  EXPECT_EQ(ValuesOf<double>(read), std::vector<double>(values.begin(), values.end()));
  const auto natural =
      Wide(std::vector<std::uint64_t>{1, 2, 3, 1ULL << 53, 5, 6, 7, 8}, WideType::kUint64);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string naturals, ReadAll(*natural, 2));
  EXPECT_EQ(ValuesOf<double>(naturals), (std::vector<double>{1, 2, 3, 0x1p53, 5, 6, 7, 8}));
}

TEST(WideSourceTest, LargerIntegersAreRefusedWithValueAndPlace) {
  const auto below =
      Wide(std::vector<std::int64_t>{0, 0, 0, 0, 0, 0, -9007199254740993, 0}, WideType::kInt64);
  EXPECT_THAT(ReadAll(*below, 1), StatusIs(absl::StatusCode::kInvalidArgument,
                                           AllOf(HasSubstr("v: the sample at (0, 1, 1)"),
                                                 HasSubstr("is -9007199254740993;"))));
  const auto above = Wide(
      std::vector<std::uint64_t>{0, std::numeric_limits<std::uint64_t>::max(), 0, 0, 0, 0, 0, 0},
      WideType::kUint64);
  EXPECT_THAT(ReadAll(*above, 2),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("(1, 0, 0)"), HasSubstr("is 18446744073709551615;"))));
}

// Every finite half against its value by powers of two; the others by their class.
TEST(WideSourceTest, EveryHalfIsItsFloat) {
  std::vector<std::uint16_t> halves(65536);
  for (std::size_t i = 0; i < halves.size(); ++i) {
    halves[i] = static_cast<std::uint16_t>(i);
  }
  const auto source = Wide(halves, WideType::kFloat16);
  EXPECT_EQ(source->info().type, volume::ScalarType::kFloat32);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, 100));
  const std::vector<float> floats = ValuesOf<float>(read);
  for (std::size_t i = 0; i < halves.size(); ++i) {
    const int exponent = static_cast<int>(i >> 10 & 31);
    const int fraction = static_cast<int>(i & 1023);
    const double sign = i < 32768 ? 1 : -1;
    ASSERT_EQ(std::signbit(floats[i]), i >= 32768) << i;
    if (exponent == 31) {
      ASSERT_EQ(std::isnan(floats[i]), fraction != 0) << i;
      ASSERT_EQ(std::isinf(floats[i]), fraction == 0) << i;
    } else {
      const double value =
          exponent == 0 ? std::ldexp(fraction, -24) : std::ldexp(1024 + fraction, exponent - 25);
      ASSERT_EQ(static_cast<double>(floats[i]), sign * value) << i;
    }
  }
}

TEST(WideSourceTest, BandsHaveTheirRowsAndNameThePlaceOfALargeInteger) {
  std::vector<std::int64_t> values(2 * 2 * 3);
  for (std::size_t i = 0; i < values.size(); ++i) {
    values[i] = static_cast<std::int64_t>(i);
  }
  std::string band(2 * 2 * sizeof(double), '?');
  ISOSCOPE_ASSERT_OK(Wide(values, WideType::kInt64)->ReadBand(1, 3, 1, 2, band.data()));
  EXPECT_EQ(ValuesOf<double>(band), (std::vector<double>{6, 7, 10, 11}));
  values[11] = (std::int64_t{1} << 53) + 1;
  EXPECT_THAT(Wide(values, WideType::kInt64)->ReadBand(1, 3, 1, 2, band.data()),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("the sample at (1, 1, 2)")));
  std::vector<std::uint16_t> halves(12, 0);
  halves[6] = 0x3c00;
  halves[11] = 0xc000;
  std::string floats(2 * 2 * sizeof(float), '?');
  ISOSCOPE_ASSERT_OK(Wide(halves, WideType::kFloat16)->ReadBand(1, 3, 1, 2, floats.data()));
  EXPECT_EQ(ValuesOf<float>(floats), (std::vector<float>{1, 0, 0, -2}));
}

}  // namespace
}  // namespace isoscope::source
