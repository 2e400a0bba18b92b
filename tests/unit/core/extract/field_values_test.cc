#include "core/extract/field_values.h"

#include <bit>
#include <cmath>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "gtest/gtest.h"
#define HWY_WANT_AVX3_DL
#include "core/base/coding.h"
#include "core/base/random.h"
#include "core/extract/block_extractor.h"
#include "hwy/targets.h"
#include "tests/support/block_cutter.h"
#include "tests/support/synthetic_fields.h"

namespace isoscope::extract {
namespace {

using math::Index3;
using volume::ScalarType;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kMost = std::numeric_limits<double>::max();
constexpr ScalarType kAllTypes[] = {ScalarType::kUint8,   ScalarType::kInt8,   ScalarType::kUint16,
                                    ScalarType::kInt16,   ScalarType::kUint32, ScalarType::kInt32,
                                    ScalarType::kFloat32, ScalarType::kFloat64};
constexpr Index3 kDims{17, 14, 12};

TEST(ValueBetweenTest, IsTheLineBetweenTheEndsAndItsLimits) {
  struct Case {
    double a;
    double b;
    double t;
    double expected;
  };
  const double third = 1.0 / 3.0;
  for (const Case& c : {Case{3, 7, 0, 3},
                        {3, 7, 0.25, 4},
                        {3, 7, 1, 7},
                        {0.1, 0.7, third, 0.1 + third * (0.7 - 0.1)},
                        {5, 5, third, 5},
                        {-kMost, kMost, 0.5, 0},
                        {-kMost, kMost, 0, -kMost},
                        {-kMost, kMost, 1, kMost},
                        {1, kInfinity, 0, 1},
                        {1, kInfinity, 0.5, kInfinity},
                        {1, -kInfinity, 1, -kInfinity},
                        {kInfinity, 1, 1, 1},
                        {kInfinity, 1, 0.5, kInfinity},
                        {kInfinity, kInfinity, 0.5, kInfinity},
                        {-kInfinity, kInfinity, 0.5, kNan},
                        {-kInfinity, kInfinity, 0, -kInfinity},
                        {kNan, 1, 1, kNan},
                        {1, kNan, 0, kNan},
                        {kNan, kInfinity, 1, kNan}}) {
    const double value = ValueBetween(c.a, c.b, c.t);
    if (std::isnan(c.expected)) {
      EXPECT_TRUE(std::isnan(value)) << c.a << ", " << c.b << ", " << c.t << ": " << value;
    } else {
      EXPECT_EQ(value, c.expected) << c.a << ", " << c.b << ", " << c.t;
    }
  }
}

// A volume in memory.
struct Samples {
  ScalarType type;
  std::string bytes;

  [[nodiscard]] double At(std::size_t index) const {
    return volume::VisitScalarType(type, [&]<typename T>() {
      return static_cast<double>(base::LoadLittleEndian<T>(bytes.data() + index * sizeof(T)));
    });
  }
};

std::size_t SampleCount() { return static_cast<std::size_t>(math::Volume(kDims)); }

// Now and then NaN or infinite, if the type has such values.
Samples WithExtremes(ScalarType type, std::uint64_t seed) {
  Samples samples{type, testing::SampleNoise(seed, kDims, type, 100)};
  if (type == ScalarType::kFloat32 || type == ScalarType::kFloat64) {
    for (std::size_t i = 0; i < SampleCount(); ++i) {
      const double draw = base::RandomUnit(seed + 1, i);
      const double value = draw < 0.01   ? kNan
                           : draw < 0.02 ? kInfinity
                           : draw < 0.03 ? -kInfinity
                           : draw < 0.04 ? 1e308
                           : draw < 0.05 ? -1e308
                                         : 0;
      if (value != 0) {
        volume::VisitScalarType(type, [&]<typename T>() {
          base::StoreLittleEndian(static_cast<T>(value), samples.bytes.data() + i * sizeof(T));
        });
      }
    }
  }
  return samples;
}

// Bits that compare: those of doubles, one for all NaN.
std::uint64_t BitsOf(double value) {
  return std::isnan(value) ? 0x7ff8'0000'0000'0000 : std::bit_cast<std::uint64_t>(value);
}

// The values at all vertices, by edge key. Expects blocks to agree.
std::map<std::int64_t, std::uint64_t> ValuesByEdge(const Samples& drawn, const Samples& field,
                                                   double isovalue, std::int64_t edge) {
  volume::GridGeometry geometry;
  geometry.sample_dims = kDims;
  const auto layout = volume::BlockLayout::Make(kDims, {edge, edge, edge}).value();
  BlockExtractor extractor(geometry, layout);
  std::map<std::int64_t, std::uint64_t> values;
  for (std::int64_t i = 0; i < layout.block_count(); ++i) {
    const auto id = static_cast<volume::BlockId>(i);
    const std::string a = testing::CutBlock(layout, drawn.type, drawn.bytes, id);
    const std::string b = testing::CutBlock(layout, field.type, field.bytes, id);
    const volume::BlockSamples samples{id, drawn.type, a.data()};
    mesh::BlockMesh plain;
    extractor.ExtractWithEdgeKeys(samples, isovalue, &plain);
    const mesh::BlockMeshView mesh =
        extractor.ExtractWithField(samples, isovalue, {id, field.type, b.data()});
    EXPECT_TRUE(std::equal(plain.positions.begin(), plain.positions.end(), mesh.positions.begin(),
                           mesh.positions.end()));
    EXPECT_TRUE(std::equal(plain.normals.begin(), plain.normals.end(), mesh.normals.begin(),
                           mesh.normals.end()));
    EXPECT_TRUE(std::equal(plain.indices.begin(), plain.indices.end(), mesh.indices.begin(),
                           mesh.indices.end()));
    EXPECT_EQ(mesh.values.size(), mesh.positions.size());
    EXPECT_EQ(mesh.values.wide().empty(), mesh.values.empty() || !HasWideValues(field.type));
    for (std::size_t v = 0; v < mesh.values.size(); ++v) {
      const std::uint64_t bits = BitsOf(mesh.values[v]);
      const auto [at, is_new] = values.insert({plain.edge_keys[v], bits});
      EXPECT_TRUE(is_new || at->second == bits) << "blocks differ in a vertex that they share";
    }
  }
  return values;
}

// The same from the whole volume, one vertex at a time.
std::map<std::int64_t, std::uint64_t> ExpectedByEdge(
    const Samples& drawn, const Samples& field, double isovalue,
    const std::map<std::int64_t, std::uint64_t>& edges) {
  const std::int64_t strides[] = {1, kDims.x, kDims.x * kDims.y};
  std::map<std::int64_t, std::uint64_t> expected;
  for (const auto& [key, bits] : edges) {
    const auto lower = static_cast<std::size_t>(key / 3);
    const std::size_t upper = lower + static_cast<std::size_t>(strides[key % 3]);
    const double a = drawn.At(lower);
    const double b = drawn.At(upper);
    double t = (isovalue - a) / (b - a);
    if (std::isinf(a) || std::isinf(b)) {
      t = !std::isinf(b) ? 1 : std::isinf(a) ? 0.5 : 0;
    } else if (std::isinf(b - a)) {
      t = (isovalue / 2 - a / 2) / (b / 2 - a / 2);
    }
    const double value = ValueBetween(field.At(lower), field.At(upper), t);
    expected[key] =
        BitsOf(HasWideValues(field.type) ? value : static_cast<double>(static_cast<float>(value)));
  }
  return expected;
}

TEST(FieldValuesTest, AreThoseOfAPlainReferenceInAnyCutForAllPairsOfTypes) {
  std::uint64_t seed = 0;
  for (const ScalarType drawn_type : kAllTypes) {
    for (const ScalarType field_type : kAllTypes) {
      SCOPED_TRACE(::testing::Message()
                   << volume::NameOf(drawn_type) << " coloured by " << volume::NameOf(field_type));
      seed += 10;
      const Samples drawn = WithExtremes(drawn_type, seed);
      const Samples field = WithExtremes(field_type, seed + 5);
      const auto values = ValuesByEdge(drawn, field, 50.25, 32);
      ASSERT_GT(values.size(), 1000U);
      EXPECT_EQ(values, ExpectedByEdge(drawn, field, 50.25, values));
      for (const std::int64_t edge : {4, 7}) {
        EXPECT_EQ(ValuesByEdge(drawn, field, 50.25, edge), values) << edge;
      }
    }
  }
}

TEST(FieldValuesTest, EveryInstructionSetGivesTheSameBits) {
  const absl::Cleanup reset = [] { hwy::SetSupportedTargetsForTest(0); };
  const std::int64_t supported = hwy::SupportedTargets();
  for (const ScalarType drawn_type :
       {ScalarType::kUint8, ScalarType::kInt16, ScalarType::kFloat32, ScalarType::kFloat64}) {
    const Samples drawn{drawn_type, testing::SampleNoise(4, kDims, drawn_type, 100)};
    const Samples field{ScalarType::kFloat64,
                        testing::SampleField(testing::RandomField(3, 20, 9.0), kDims,
                                             ScalarType::kFloat64, 7, 101325)};
    std::map<std::int64_t, std::uint64_t> expected;
    for (std::int64_t rest = supported; rest != 0; rest &= rest - 1) {
      hwy::SetSupportedTargetsForTest(rest & -rest);
      const auto values = ValuesByEdge(drawn, field, 40, 8);
      if (expected.empty()) {
        expected = values;
      }
      EXPECT_EQ(values, expected) << hwy::TargetName(rest & -rest);
    }
    EXPECT_GT(expected.size(), 1000U);
  }
}

TEST(FieldValuesTest, ALinearFieldIsThatOfTheVertexsPosition) {
  const auto linear = [](double x, double y, double z) { return 2 * x - 3 * y + 6 * z + 0.25; };
  for (const ScalarType type : {ScalarType::kFloat32, ScalarType::kFloat64}) {
    Samples field{type, ""};
    for (std::int64_t z = 0; z < kDims.z; ++z) {
      for (std::int64_t y = 0; y < kDims.y; ++y) {
        for (std::int64_t x = 0; x < kDims.x; ++x) {
          const double value =
              linear(static_cast<double>(x), static_cast<double>(y), static_cast<double>(z));
          volume::VisitScalarType(type, [&]<typename T>() {
            base::AppendLittleEndian(static_cast<T>(value), &field.bytes);
          });
        }
      }
    }
    volume::GridGeometry geometry;
    geometry.sample_dims = kDims;
    const auto layout = volume::BlockLayout::Make(kDims, {32, 32, 32}).value();
    const std::string drawn = testing::SampleNoise(9, kDims, ScalarType::kUint8, 200);
    BlockExtractor extractor(geometry, layout);
    const mesh::BlockMeshView mesh = extractor.ExtractWithField(
        {0, ScalarType::kUint8, drawn.data()}, 90.5, {0, type, field.bytes.data()});
    ASSERT_GT(mesh.values.size(), 1000U);
    for (std::size_t v = 0; v < mesh.values.size(); ++v) {
      const math::Vec3f& p = mesh.positions[v];
      // Coordinates are rounded to floats of at most 17.
      ASSERT_NEAR(
          mesh.values[v],
          linear(static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z)),
          11 * 1e-6 + 1e-5);
    }
  }
}

}  // namespace
}  // namespace isoscope::extract
