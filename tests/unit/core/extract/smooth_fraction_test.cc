#include "core/extract/smooth_fraction.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/random.h"
#include "core/volume/scalar_type.h"

namespace isoscope::extract {
namespace {

using math::Index3;
using volume::ScalarType;

constexpr Index3 kDims{7, 8, 9};
constexpr math::IndexBox kStored{{20, 30, 40}, {27, 38, 49}};

// Samples that are stored, by their place among them.
std::string BytesOf(ScalarType type, const std::function<double(const Index3&)>& label_at) {
  std::string bytes;
  volume::VisitScalarType(type, [&]<typename T>() {
    for (std::int64_t z = 0; z < kDims.z; ++z) {
      for (std::int64_t y = 0; y < kDims.y; ++y) {
        for (std::int64_t x = 0; x < kDims.x; ++x) {
          base::AppendLittleEndian(static_cast<T>(label_at({x, y, z})), &bytes);
        }
      }
    }
  });
  return bytes;
}

double FractionOf(const std::function<double(const Index3&)>& label_at, const Index3& lower,
                  int axis, ScalarType type = ScalarType::kUint8) {
  const std::string bytes = BytesOf(type, label_at);
  return SmoothFraction({0, type, bytes.data()}, kStored, kStored.begin + lower, axis);
}

TEST(SmoothFractionTest, AFlatBorderStaysInTheMiddleAlsoWhereTheVolumeEnds) {
  for (int axis = 0; axis < 3; ++axis) {
    for (const std::int64_t last : {0, 1, 3, 5}) {
      const auto halves = [&](const Index3& at) { return at[axis] <= last ? 3.0 : 7.0; };
      for (const std::int64_t beside : {0, 3, 6}) {
        Index3 lower{beside, beside, beside};
        lower[axis] = last;
        EXPECT_EQ(FractionOf(halves, lower, axis), 0.5) << axis << ", " << last << ", " << beside;
      }
    }
  }
}

// Columns of 3 below 7, of heights 3 and, from x = 4 on, 4: worked by hand.
TEST(SmoothFractionTest, AStepBecomesASlope) {
  const auto stair = [](const Index3& at) { return at.z <= (at.x < 4 ? 3 : 4) ? 3.0 : 7.0; };
  EXPECT_EQ(FractionOf(stair, {2, 4, 3}, 2), 0.5);
  EXPECT_EQ(FractionOf(stair, {3, 4, 3}, 2), 5.0 / 7);  // 40 / (40 + 16)
  EXPECT_EQ(FractionOf(stair, {4, 4, 4}, 2), 2.0 / 7);
  EXPECT_EQ(FractionOf(stair, {5, 4, 4}, 2), 0.5);
}

TEST(SmoothFractionTest, ThinAndSingleSamplesKeepHalfOfTheirWidth) {
  const auto sheet = [](const Index3& at) { return at.y == 3 ? 1.0 : 0.0; };
  EXPECT_EQ(FractionOf(sheet, {3, 2, 4}, 1), 0.75);
  EXPECT_EQ(FractionOf(sheet, {3, 3, 4}, 1), 0.25);
  const auto grain = [](const Index3& at) { return at == Index3{3, 3, 3} ? 1.0 : 0.0; };
  for (int axis = 0; axis < 3; ++axis) {
    Index3 before{3, 3, 3};
    --before[axis];
    EXPECT_EQ(FractionOf(grain, before, axis), 0.75);
    EXPECT_EQ(FractionOf(grain, {3, 3, 3}, axis), 0.25);
  }
  // Each of two ends is alone among samples of the other.
  const auto swapped = [](const Index3& at) {
    return at.x == 3 && at.y == 3 && (at.z == 3 || at.z == 4) ? (at.z == 3 ? 1.0 : 0.0)
                                                              : (at.z <= 3 ? 0.0 : 1.0);
  };
  EXPECT_EQ(FractionOf(swapped, {3, 3, 3}, 2), 0.5);
}

TEST(SmoothFractionTest, AThirdLabelCountsForNeither) {
  // 5 in place of a half of the samples, on both sides alike.
  const auto alike = [](const Index3& at) { return at.x > 3 ? 5.0 : at.z <= 3 ? 3.0 : 7.0; };
  EXPECT_EQ(FractionOf(alike, {3, 4, 3}, 2), 0.5);
  // Below alone: d is 12 + 24 - 16 = 20, then 12 - 32 - 16 = -36.
  const auto below = [](const Index3& at) { return at.z > 3 ? 7.0 : at.x > 3 ? 5.0 : 3.0; };
  EXPECT_EQ(FractionOf(below, {3, 4, 3}, 2), 20.0 / 56);
}

// Labels are names: what they are called, their type and their order change nothing.
TEST(SmoothFractionTest, NamesAndTypesOfLabelsDoNotMatter) {
  const auto noise = [](const Index3& at) {
    return static_cast<double>(
        base::RandomBits(3, static_cast<std::uint64_t>(at.x + 7 * (at.y + 8 * at.z)) / 2) % 4);
  };
  constexpr std::array<double, 4> kOtherNames{9, 2, 101, 0};
  const auto renamed = [&](const Index3& at) {
    return kOtherNames[static_cast<std::size_t>(noise(at))];
  };
  int moved = 0;
  for (std::int64_t z = 1; z < 7; ++z) {
    for (std::int64_t x = 1; x < 5; ++x) {
      for (int axis = 0; axis < 3; ++axis) {
        const Index3 lower{x, 3, z};
        Index3 upper = lower;
        ++upper[axis];
        if (noise(lower) == noise(upper)) {
          continue;
        }
        const double t = FractionOf(noise, lower, axis);
        moved += t != 0.5 ? 1 : 0;
        for (const ScalarType type :
             {ScalarType::kInt8, ScalarType::kUint16, ScalarType::kInt16, ScalarType::kUint32,
              ScalarType::kInt32, ScalarType::kFloat32, ScalarType::kFloat64}) {
          EXPECT_EQ(FractionOf(renamed, lower, axis, type), t);
        }
        // Seen from the other end.
        const auto mirrored = [&](const Index3& at) {
          Index3 from = at;
          from[axis] = lower[axis] + upper[axis] - at[axis];
          return noise({std::clamp<std::int64_t>(from.x, 0, 6),
                        std::clamp<std::int64_t>(from.y, 0, 7),
                        std::clamp<std::int64_t>(from.z, 0, 8)});
        };
        EXPECT_NEAR(FractionOf(mirrored, lower, axis), 1 - t, 1e-15);
      }
    }
  }
  EXPECT_GT(moved, 20);
}

TEST(SmoothFractionTest, ManyEdgesAreAsOne) {
  const std::string bytes = BytesOf(ScalarType::kUint16, [](const Index3& at) {
    return static_cast<double>(
        base::RandomBits(8, static_cast<std::uint64_t>(at.x + 7 * (at.y + 8 * at.z))) % 3);
  });
  const volume::BlockSamples samples{0, ScalarType::kUint16, bytes.data()};
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<std::uint32_t> lower;
    std::vector<double> expected;
    for (std::int64_t z = 1; z < 7; ++z) {
      for (std::int64_t y = 1; y < 6; ++y) {
        for (std::int64_t x = 1; x < 5; ++x) {
          lower.push_back(static_cast<std::uint32_t>(x + 7 * (y + 8 * z)));
          expected.push_back(
              SmoothFraction(samples, kStored, kStored.begin + Index3{x, y, z}, axis));
        }
      }
    }
    std::vector<double> actual(lower.size());
    FillSmoothFractions(samples, kDims, axis, lower, actual.data());
    EXPECT_EQ(actual, expected);
  }
}

}  // namespace
}  // namespace isoscope::extract
