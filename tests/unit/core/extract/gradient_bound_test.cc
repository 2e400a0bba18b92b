// The bound of a volume is compared with the longest gradient of its samples:
//
// - for every type and block size;
// - with samples that are not finite, in the block or elsewhere in it;
// - at the limits of double: tiny, huge and constant fields.

#include "core/extract/gradient_bound.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/random.h"
#include "core/extract/block_extractor.h"
#include "core/volume/field_gradient.h"
#include "core/volume/sample_histogram.h"
#include "tests/support/block_cutter.h"
#include "tests/support/synthetic_fields.h"

namespace isoscope::extract {
namespace {

using volume::ScalarType;

constexpr math::Index3 kDims{19, 14, 11};

volume::GridGeometry Oblique() {
  volume::GridGeometry geometry;
  geometry.sample_dims = kDims;
  geometry.spacing = {0.5, 1.25, 3};
  geometry.direction.columns = {math::Vec3d{0.6, 0.8, 0}, math::Vec3d{-0.8, 0.6, 0},
                                math::Vec3d{0, 0, 1}};
  return geometry;
}

// The bound of the whole volume, from blocks of this size.
double BoundOf(const volume::GridGeometry& geometry, ScalarType type, const std::string& bytes,
               std::int64_t edge) {
  const auto layout = volume::BlockLayout::Make(kDims, {edge, edge, edge}).value();
  double bound = 0;
  for (std::int64_t i = 0; i < layout.block_count(); ++i) {
    const auto id = static_cast<volume::BlockId>(i);
    const std::string block = testing::CutBlock(layout, type, bytes, id);
    bound =
        MaxGradientMagnitude(layout, geometry.world_gradient_from_index(), {id, type, block.data()},
                             volume::CountedSamplesOf(layout, id), bound);
  }
  return bound;
}

// The same from single samples.
double LongestGradient(const volume::GridGeometry& geometry, ScalarType type,
                       const std::string& bytes) {
  const auto layout = volume::BlockLayout::Make(kDims, {32, 32, 32}).value();
  const std::string block = testing::CutBlock(layout, type, bytes, 0);
  double longest = 0;
  for (std::int64_t z = 0; z < kDims.z; ++z) {
    for (std::int64_t y = 0; y < kDims.y; ++y) {
      for (std::int64_t x = 0; x < kDims.x; ++x) {
        const math::Vec3d g = volume::GradientAt(
            geometry, layout, {0, type, block.data()},
            {static_cast<double>(x), static_cast<double>(y), static_cast<double>(z)});
        const double length = std::hypot(g.x, g.y, g.z);
        longest = std::isfinite(length) ? std::max(longest, length) : longest;
      }
    }
  }
  return longest;
}

// The longest gradient of the vertices at an isovalue.
float LongestOfVertices(const volume::GridGeometry& geometry, ScalarType type,
                        const std::string& bytes, double isovalue) {
  const auto layout = volume::BlockLayout::Make(kDims, {8, 8, 8}).value();
  BlockExtractor extractor(geometry, layout);
  float longest = 0;
  for (std::int64_t i = 0; i < layout.block_count(); ++i) {
    const auto id = static_cast<volume::BlockId>(i);
    const std::string block = testing::CutBlock(layout, type, bytes, id);
    for (const float magnitude :
         extractor.Extract({id, type, block.data()}, isovalue, true).values.narrow()) {
      longest = std::max(longest, magnitude);
    }
  }
  return longest;
}

TEST(GradientBoundTest, OfALinearFieldItIsTheLengthOfItsGradient) {
  const volume::GridGeometry geometry = Oblique();
  std::string bytes;
  for (std::int64_t z = 0; z < kDims.z; ++z) {
    for (std::int64_t y = 0; y < kDims.y; ++y) {
      for (std::int64_t x = 0; x < kDims.x; ++x) {
        base::AppendLittleEndian(static_cast<float>(2 * x - 3 * y + 6 * z), &bytes);
      }
    }
  }
  // 2 / 0.5, 3 / 1.25 and 6 / 3 on three orthogonal axes.
  const double expected = std::sqrt(4.0 * 4 + 2.4 * 2.4 + 2 * 2);
  for (const std::int64_t edge : {5, 8, 32}) {
    EXPECT_NEAR(BoundOf(geometry, ScalarType::kFloat32, bytes, edge), expected, 1e-12) << edge;
  }
}

TEST(GradientBoundTest, ItIsTheLongestGradientOfASampleForAnyTypeAndCut) {
  for (const ScalarType type :
       {ScalarType::kUint8, ScalarType::kInt8, ScalarType::kUint16, ScalarType::kInt16,
        ScalarType::kUint32, ScalarType::kInt32, ScalarType::kFloat32, ScalarType::kFloat64}) {
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      const volume::GridGeometry geometry = Oblique();
      const std::string bytes = testing::SampleNoise(seed, kDims, type, 100);
      const double expected = LongestGradient(geometry, type, bytes);
      ASSERT_GT(expected, 0);
      const double bound = BoundOf(geometry, type, bytes, 8);
      EXPECT_NEAR(bound, expected, 1e-12 * expected);
      EXPECT_EQ(BoundOf(geometry, type, bytes, 5), bound) << "another cut";
      EXPECT_EQ(BoundOf(geometry, type, bytes, 3), bound) << "another cut";
      for (const double isovalue : {1.0, 37.5, 50.0, 99.0}) {
        EXPECT_LE(static_cast<double>(LongestOfVertices(geometry, type, bytes, isovalue)),
                  bound * (1 + 1e-6));
      }
    }
  }
}

TEST(GradientBoundTest, SamplesThatAreNotFiniteGiveWayToTheirNeighbours) {
  const volume::GridGeometry geometry = Oblique();
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    std::string bytes;
    for (std::uint64_t i = 0; i < static_cast<std::uint64_t>(math::Volume(kDims)); ++i) {
      constexpr float kInfinity = std::numeric_limits<float>::infinity();
      const double dice = base::RandomUnit(seed, 2 * i);
      const auto value = static_cast<float>(base::RandomUnit(seed, 2 * i + 1));
      base::AppendLittleEndian(dice < 0.02   ? std::numeric_limits<float>::quiet_NaN()
                               : dice < 0.03 ? kInfinity
                               : dice < 0.04 ? -kInfinity
                                             : value,
                               &bytes);
    }
    const double expected = LongestGradient(geometry, ScalarType::kFloat32, bytes);
    EXPECT_NEAR(BoundOf(geometry, ScalarType::kFloat32, bytes, 8), expected, 1e-12);
    EXPECT_LE(static_cast<double>(LongestOfVertices(geometry, ScalarType::kFloat32, bytes, 0.5)),
              expected * (1 + 1e-6));
  }
}

TEST(GradientBoundTest, SamplesThatAreNotFiniteElsewhereInABlockChangeNoBit) {
  const volume::GridGeometry geometry = Oblique();
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    std::string bytes;
    for (std::uint64_t i = 0; i < static_cast<std::uint64_t>(math::Volume(kDims)); ++i) {
      const bool is_nan = base::RandomUnit(seed, 2 * i) < 0.001;
      base::AppendLittleEndian(
          is_nan ? std::numeric_limits<double>::quiet_NaN() : base::RandomUnit(seed, 2 * i + 1),
          &bytes);
    }
    const double bound = BoundOf(geometry, ScalarType::kFloat64, bytes, 32);
    for (const std::int64_t edge : {2, 3, 5, 8}) {
      EXPECT_EQ(BoundOf(geometry, ScalarType::kFloat64, bytes, edge), bound) << seed << ' ' << edge;
    }
  }
}

TEST(GradientBoundTest, TinyGradientsDoNotVanish) {
  const volume::GridGeometry geometry = Oblique();
  for (const double scale : {1e-100, 1e-150, 1e-162, 1e-165, 1e-200, 1e-300, 1e-306}) {
    std::string bytes;
    for (std::uint64_t i = 0; i < static_cast<std::uint64_t>(math::Volume(kDims)); ++i) {
      base::AppendLittleEndian(scale * (2 * base::RandomUnit(3, i) - 1), &bytes);
    }
    const double expected = LongestGradient(geometry, ScalarType::kFloat64, bytes);
    ASSERT_GT(expected, 0);
    const double bound = BoundOf(geometry, ScalarType::kFloat64, bytes, 8);
    EXPECT_NEAR(bound / expected, 1, 1e-12) << scale;
    EXPECT_EQ(BoundOf(geometry, ScalarType::kFloat64, bytes, 5), bound) << scale;
  }
}

TEST(GradientBoundTest, ScalingByAPowerOfTwoScalesTheBound) {
  const volume::GridGeometry geometry = Oblique();
  const auto bound_of = [&](double scale) {
    std::string bytes;
    for (std::uint64_t i = 0; i < static_cast<std::uint64_t>(math::Volume(kDims)); ++i) {
      base::AppendLittleEndian(scale * base::RandomUnit(7, i), &bytes);
    }
    return BoundOf(geometry, ScalarType::kFloat64, bytes, 8);
  };
  const double bound = bound_of(1);
  for (const int exponent : {-900, -560, -470, -440, -400, -1, 1, 400, 500, 520, 1000}) {
    EXPECT_EQ(bound_of(std::ldexp(1.0, exponent)), std::ldexp(bound, exponent)) << exponent;
  }
}

TEST(GradientBoundTest, HugeAndConstantFieldsHaveFiniteBounds) {
  const volume::GridGeometry geometry = Oblique();
  for (const double scale : {0.0, 0x1p-1070, 1e-300, 1e300, 1.7e308}) {
    std::string bytes;
    for (std::uint64_t i = 0; i < static_cast<std::uint64_t>(math::Volume(kDims)); ++i) {
      base::AppendLittleEndian(scale * (2 * base::RandomUnit(3, i) - 1), &bytes);
    }
    const double bound = BoundOf(geometry, ScalarType::kFloat64, bytes, 8);
    EXPECT_TRUE(std::isfinite(bound)) << scale;
    EXPECT_EQ(bound > 0, scale > 0) << scale;
    EXPECT_TRUE(std::isfinite(LongestOfVertices(geometry, ScalarType::kFloat64, bytes, 0)));
  }
}

}  // namespace
}  // namespace isoscope::extract
