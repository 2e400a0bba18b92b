#include "tests/support/synthetic_fields.h"

#include <cmath>
#include <cstdint>
#include <set>
#include <string>

#include "gtest/gtest.h"

#include "core/base/coding.h"

namespace isoscope::testing {
namespace {

TEST(SyntheticFieldsTest, FieldsHaveTheirKnownValues) {
  EXPECT_DOUBLE_EQ(SphereField(0.7)({0.3, 0, 0.4}), 0.2);
  EXPECT_DOUBLE_EQ(TorusField(0.6, 0.25)({0, 0.6, 0}), 0.25);
  EXPECT_NEAR(TorusField(0.6, 0.25)({0.85, 0, 0}), 0, 1e-15);
  EXPECT_DOUBLE_EQ(GyroidField(1)({0.5, 0, 0}), 1);
  EXPECT_NEAR(MarschnerLobbField(6, 0.25)({0, 0, 0}), 0.6, 1e-12);
}

TEST(SyntheticFieldsTest, RandomFieldDependsOnItsSeedOnlyAndHasUnitVariance) {
  const math::Vec3d p{0.1, 0.2, 0.3};
  EXPECT_EQ(RandomField(1, 10, 5)(p), RandomField(1, 10, 5)(p));
  EXPECT_NE(RandomField(1, 10, 5)(p), RandomField(2, 10, 5)(p));
  const Field field = RandomField(1, 64, 12);
  double square_sum = 0;
  for (int i = 0; i < 20000; ++i) {
    const double value = field({std::fmod(0.37 * i, 20.0), std::fmod(0.11 * i, 20.0), 0.01 * i});
    square_sum += value * value / 20000;
  }
  EXPECT_NEAR(square_sum, 1, 0.2);
}

TEST(SyntheticFieldsTest, SamplesRunXFastestOverTheWholeCube) {
  const Field field = [](const math::Vec3d& p) { return p.x + 10 * p.y + 100 * p.z; };
  const std::string bytes = SampleField(field, {3, 2, 2}, volume::ScalarType::kFloat64, 2, 1);
  ASSERT_EQ(bytes.size(), 12U * 8);
  const auto at = [&](std::size_t i) { return base::LoadLittleEndian<double>(&bytes[8 * i]); };
  EXPECT_DOUBLE_EQ(at(0), 1 + 2 * -111.0);
  EXPECT_DOUBLE_EQ(at(1), 1 + 2 * -110.0);
  EXPECT_DOUBLE_EQ(at(3), 1 + 2 * -91.0);
  EXPECT_DOUBLE_EQ(at(11), 1 + 2 * 111.0);
}

TEST(SyntheticFieldsTest, IntegersAreRoundedAndClamped) {
  const Field field = [](const math::Vec3d& p) { return p.x; };
  const std::string bytes = SampleField(field, {3, 2, 2}, volume::ScalarType::kUint8, 300, 100.6);
  EXPECT_EQ(static_cast<std::uint8_t>(bytes[0]), 0);
  EXPECT_EQ(static_cast<std::uint8_t>(bytes[1]), 101);
  EXPECT_EQ(static_cast<std::uint8_t>(bytes[2]), 255);
}

TEST(SyntheticFieldsTest, NoiseCoversItsRangeAndRepeats) {
  const std::string bytes = SampleNoise(3, {10, 10, 10}, volume::ScalarType::kUint8, 4);
  EXPECT_EQ(bytes, SampleNoise(3, {10, 10, 10}, volume::ScalarType::kUint8, 4));
  EXPECT_NE(bytes, SampleNoise(4, {10, 10, 10}, volume::ScalarType::kUint8, 4));
  EXPECT_EQ(std::set<char>(bytes.begin(), bytes.end()), (std::set<char>{0, 1, 2, 3, 4}));
}

}  // namespace
}  // namespace isoscope::testing
