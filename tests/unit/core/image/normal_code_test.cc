#include "core/image/normal_code.h"

#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

#include "gtest/gtest.h"

#include "core/base/random.h"

namespace isoscope::image {
namespace {

// The angle between two vectors, in degrees.
double Angle(const std::array<double, 3>& a, const std::array<float, 3>& b) {
  double cross_squared = 0;
  double dot = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    const double c = a[(i + 1) % 3] * static_cast<double>(b[(i + 2) % 3]) -
                     a[(i + 2) % 3] * static_cast<double>(b[(i + 1) % 3]);
    cross_squared += c * c;
    dot += a[i] * static_cast<double>(b[i]);
  }
  return std::atan2(std::sqrt(cross_squared), dot) * 180 / std::numbers::pi;
}

TEST(NormalCodeTest, EveryDirectionComesBackWithinAHundredthOfADegree) {
  for (std::uint64_t i = 0; i < 100000; ++i) {
    const auto unit = [&](std::uint64_t k) { return 2 * base::RandomUnit(3, 3 * i + k) - 1; };
    const std::array<double, 3> v{unit(0), unit(1), unit(2)};
    const std::array<float, 3> back = DecodeNormal(EncodeNormal(v));
    ASSERT_LT(Angle(v, back), 0.01);
    ASSERT_NEAR(std::hypot(back[0], back[1], back[2]), 1, 1e-6);
  }
}

TEST(NormalCodeTest, AxesAndDiagonalsOfTheLowerHalfComeBack) {
  for (const double x : {-1.0, 0.0, 1.0}) {
    for (const double y : {-1.0, 0.0, 1.0}) {
      for (const double z : {-1.0, 0.0, 1.0}) {
        if (x != 0 || y != 0 || z != 0) {
          EXPECT_LT(Angle({x, y, z}, DecodeNormal(EncodeNormal({x, y, z}))), 0.01);
        }
      }
    }
  }
}

TEST(NormalCodeTest, WhatHasNoDirectionHasACodeOfItsOwn) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double inf = std::numeric_limits<double>::infinity();
  EXPECT_EQ(EncodeNormal({0, 0, 0}), kNoNormal);
  EXPECT_EQ(EncodeNormal({nan, 0, 1}), kNoNormal);
  EXPECT_EQ(EncodeNormal({inf, 0, 1}), kNoNormal);
  EXPECT_EQ(DecodeNormal(kNoNormal), (std::array<float, 3>{0, 0, 0}));
}

TEST(NormalCodeTest, AnyCodeIsAFiniteVector) {
  for (std::uint32_t i = 0; i < 1000000; ++i) {
    const auto bits = static_cast<std::uint32_t>(base::RandomBits(1, i));
    const std::array<float, 3> v = DecodeNormal(std::bit_cast<Rgba8>(bits));
    ASSERT_TRUE(std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2])) << bits;
  }
}

}  // namespace
}  // namespace isoscope::image
