#include "core/source/adapt/magnitude_source.h"

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/memory_source.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::MakeMemorySource;
using ::isoscope::testing::Noise;
using volume::ScalarType;

template <typename T>
std::string BytesOf(const std::vector<T>& values) {
  std::string bytes(values.size() * sizeof(T), '\0');
  std::memcpy(bytes.data(), values.data(), bytes.size());
  return bytes;
}

template <typename T>
std::vector<T> ValuesOf(const std::string& bytes) {
  std::vector<T> values(bytes.size() / sizeof(T));
  std::memcpy(values.data(), bytes.data(), bytes.size());
  return values;
}

volume::GridGeometry Grid(const math::Index3& dims) {
  volume::GridGeometry geometry;
  geometry.sample_dims = dims;
  return geometry;
}

std::string ReadAll(VolumeSource* source) {
  const math::Index3& dims = source->info().geometry.sample_dims;
  std::string out(
      static_cast<std::size_t>(math::Volume(dims)) * volume::SizeOf(source->info().type), '\0');
  EXPECT_TRUE(source->ReadSlab(0, dims.z, out.data()).ok());
  return out;
}

std::unique_ptr<VolumeSource> TestVolume(const std::string& samples, const math::Index3& dims,
                                         ScalarType type) {
  return MakeMemorySource(Grid(dims), type, samples, "test");
}

TEST(MagnitudeSourceTest, TypeIsFloat32OnlyWhereItHoldsEveryComponent) {
  using enum ScalarType;
  for (const ScalarType type : {kUint8, kInt8, kUint16, kInt16, kFloat32}) {
    EXPECT_EQ(MagnitudeType({type}), kFloat32);
    EXPECT_EQ(MagnitudeType({kInt16, type, kFloat32}), kFloat32);
  }
  for (const ScalarType type : {kUint32, kInt32, kFloat64}) {
    EXPECT_EQ(MagnitudeType({type}), kFloat64);
    EXPECT_EQ(MagnitudeType({kInt16, type, kFloat32}), kFloat64);
  }
}

TEST(MagnitudeSourceTest, KnownVectors) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const math::Index3 dims{2, 2, 2};
  const std::vector<float> x{3, -2, 0, kNan, 1e30F, kInfinity, 1, 0.1F};
  const std::vector<float> y{4, 3, 0, 1, 1e30F, 2, kNan, 0.2F};
  const std::vector<float> z{0, -6, 0, 1, 0, kNan, kInfinity, 0.3F};
  std::vector<std::unique_ptr<VolumeSource>> components;
  for (const auto& values : {x, y, z}) {
    components.push_back(TestVolume(BytesOf(values), dims, ScalarType::kFloat32));
  }
  const auto source = MakeMagnitudeSource(std::move(components));
  const std::vector<float> lengths = ValuesOf<float>(ReadAll(source.get()));
  EXPECT_EQ(lengths[0], 5);
  EXPECT_EQ(lengths[1], 7);
  EXPECT_EQ(lengths[2], 0);
  EXPECT_EQ(lengths[4], static_cast<float>(std::sqrt(2.0) * double{1e30F}));
  for (const std::size_t i : {3U, 5U, 6U}) {
    EXPECT_EQ(std::bit_cast<std::uint32_t>(lengths[i]), 0x7fc00000U) << i;
  }
}

TEST(MagnitudeSourceTest, MixedTypesInAnyRunOfRows) {
  const math::Index3 dims{5, 3, 4};
  const std::string a = Noise(dims, ScalarType::kInt16);
  const std::string b = Noise(dims, ScalarType::kUint32);
  std::vector<std::unique_ptr<VolumeSource>> components;
  components.push_back(TestVolume(a, dims, ScalarType::kInt16));
  components.push_back(TestVolume(b, dims, ScalarType::kUint32));
  const auto source = MakeMagnitudeSource(std::move(components));
  ASSERT_EQ(source->info().type, ScalarType::kFloat64);
  std::vector<double> expected;
  for (std::size_t i = 0; i < 60; ++i) {
    const double first = ValuesOf<std::int16_t>(a)[i];
    const double second = ValuesOf<std::uint32_t>(b)[i];
    expected.push_back(std::sqrt(first * first + second * second));
  }
  EXPECT_EQ(ValuesOf<double>(ReadAll(source.get())), expected);
  for (std::int64_t begin = 0; begin < 12; ++begin) {
    std::string rows(static_cast<std::size_t>(12 - begin) * 5 * 8, '\0');
    ISOSCOPE_ASSERT_OK(source->ReadRows(begin, 12, rows.data()));
    EXPECT_EQ(ValuesOf<double>(rows),
              std::vector<double>(expected.begin() + begin * 5, expected.end()));
  }
}

// More than one portion of 256 Ki samples.
TEST(MagnitudeSourceTest, LargeReadsAreDoneInPortions) {
  const math::Index3 dims{700, 500, 2};
  const std::string samples = Noise(dims, ScalarType::kInt8);
  std::vector<std::unique_ptr<VolumeSource>> components;
  components.push_back(TestVolume(samples, dims, ScalarType::kInt8));
  const auto source = MakeMagnitudeSource(std::move(components));
  const std::vector<float> lengths = ValuesOf<float>(ReadAll(source.get()));
  const std::vector<std::int8_t> values = ValuesOf<std::int8_t>(samples);
  for (std::size_t i = 0; i < values.size(); ++i) {
    ASSERT_EQ(lengths[i], std::abs(static_cast<float>(values[i]))) << i;
  }
  EXPECT_LE(source->info().memory_bytes, std::int64_t{256} * 1024 * 16);
}

}  // namespace
}  // namespace isoscope::source
