// The largest differences against their definition, sample by sample, on every instruction set.

#include "core/extract/difference_kernel.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/random.h"
#include "hwy/targets.h"

namespace isoscope::extract {
namespace {

template <typename Fn>
void OnEachTarget(const Fn& fn) {
  const absl::Cleanup restore = [] { hwy::SetSupportedTargetsForTest(0); };
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    SCOPED_TRACE(hwy::TargetName(target));
    hwy::SetSupportedTargetsForTest(target);
    fn();
  }
}

Strides GridOf(const std::array<std::size_t, 3>& dims) {
  return {.samples = {1, dims[0], dims[0] * dims[1]}, .dims = dims};
}

// The definition. Differences of floats are rounded to float.
template <typename T>
std::array<double, 3> Expected(const std::vector<T>& samples, const Strides& grid,
                               const math::IndexBox& box) {
  using Difference = std::conditional_t<std::is_floating_point_v<T>, T, std::int64_t>;
  std::array<double, 3> largest{};
  for (std::int64_t z = box.begin.z; z < box.end.z; ++z) {
    for (std::int64_t y = box.begin.y; y < box.end.y; ++y) {
      for (std::int64_t x = box.begin.x; x < box.end.x; ++x) {
        const std::size_t at = static_cast<std::size_t>(x) +
                               static_cast<std::size_t>(y) * grid.samples[1] +
                               static_cast<std::size_t>(z) * grid.samples[2];
        for (std::size_t axis = 0; axis < 3; ++axis) {
          const auto after = static_cast<Difference>(samples[at + grid.samples[axis]]);
          const auto before = static_cast<Difference>(samples[at - grid.samples[axis]]);
          const auto difference = static_cast<double>(static_cast<Difference>(after - before));
          if (!std::isnan(difference)) {
            largest[axis] = std::max(largest[axis], std::abs(difference));
          }
        }
      }
    }
  }
  return largest;
}

// Bytes at an odd address: samples have any alignment.
template <typename T>
std::string BytesOf(const std::vector<T>& samples) {
  std::string bytes = "?";
  for (const T sample : samples) {
    base::AppendLittleEndian(sample, &bytes);
  }
  return bytes;
}

template <typename T>
void ExpectMatches(const std::vector<T>& samples, const Strides& grid, const math::IndexBox& box) {
  const std::string bytes = BytesOf(samples);
  OnEachTarget([&] {
    EXPECT_EQ(LargestDifferences<T>(bytes.data() + 1, grid, box), Expected(samples, grid, box))
        << box.end.x << " x " << box.end.y << " x " << box.end.z;
  });
}

template <typename T>
class DifferenceKernelTest : public ::testing::Test {};
using Types = ::testing::Types<std::uint8_t, std::int8_t, std::uint16_t, std::int16_t, float>;
TYPED_TEST_SUITE(DifferenceKernelTest, Types);

TYPED_TEST(DifferenceKernelTest, RowsOfAnyLengthMatchTheDefinition) {
  for (std::size_t columns = 1; columns <= 40; ++columns) {
    const Strides grid = GridOf({columns + 2, 5, 4});
    std::vector<TypeParam> samples(grid.samples[2] * grid.dims[2]);
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const std::uint64_t bits = base::RandomBits(columns, i);
      samples[i] = std::is_integral_v<TypeParam> ? static_cast<TypeParam>(bits)
                                                 : static_cast<TypeParam>(bits % 1000) / 7;
    }
    ExpectMatches(samples, grid,
                  {.begin = {1, 1, 1}, .end = {static_cast<std::int64_t>(columns) + 1, 4, 3}});
  }
}

// A single step of the whole range, at each place of a row and along each axis.
TYPED_TEST(DifferenceKernelTest, TheWholeRangeOfATypeIsADifference) {
  constexpr std::size_t kColumns = 18;
  const Strides grid = GridOf({kColumns + 2, 3, 3});
  const auto lowest = std::numeric_limits<TypeParam>::lowest();
  const auto highest =
      std::is_integral_v<TypeParam> ? std::numeric_limits<TypeParam>::max() : TypeParam{0};
  for (std::size_t i = 0; i < grid.samples[2] * grid.dims[2]; ++i) {
    std::vector<TypeParam> samples(grid.samples[2] * grid.dims[2], lowest);
    samples[i] = highest;
    ExpectMatches(samples, grid, {.begin = {1, 1, 1}, .end = {kColumns + 1, 2, 2}});
  }
}

TEST(DifferenceKernelOfFloatsTest, NanIsLeftOutAndInfinityIsNot) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const Strides grid = GridOf({23, 6, 5});
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    std::vector<float> samples(grid.samples[2] * grid.dims[2]);
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const double dice = base::RandomUnit(seed, 2 * i);
      const bool has_infinity = seed % 2 == 0;
      samples[i] = dice < 0.2                    ? kNan
                   : has_infinity && dice < 0.21 ? kInfinity
                   : has_infinity && dice < 0.22 ? -kInfinity
                                                 : static_cast<float>(dice);
    }
    ExpectMatches(samples, grid, {.begin = {1, 1, 1}, .end = {22, 5, 4}});
  }
}

}  // namespace
}  // namespace isoscope::extract
