#include "core/composite/number_code.h"

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "hwy/highway.h"
#include "hwy/targets.h"

namespace isoscope::composite {
namespace {

TEST(NumberCodeTest, ClassesFollowOneAnotherWithoutGapsUpToTheLargestNumber) {
  for (const NumberCode& code : {kDepthCode, kColorCode}) {
    EXPECT_EQ(code.bases[0], 0U);
    for (std::size_t c = 0; c + 1 < code.bases.size(); ++c) {
      EXPECT_EQ(std::uint64_t{code.bases[c]} + (std::uint64_t{1} << code.bits[c]),
                code.bases[c + 1])
          << c;
    }
    EXPECT_GE(std::uint64_t{code.bases[15]} + (std::uint64_t{1} << code.bits[15]),
              std::uint64_t{1} << 32);
  }
}

TEST(NumberCodeTest, ZigZagAndBackIsTheSameAndSmallStaysSmall) {
  for (const std::uint32_t difference : {0U, 1U, 0xffffffffU, 2U, 0x7fffffffU, 0x80000000U}) {
    EXPECT_EQ(UnZigZag(ZigZag(difference)), difference);
  }
  EXPECT_EQ(ZigZag(1), 2U);
  EXPECT_EQ(ZigZag(0U - 1), 1U);
}

// Returns the class of `number` by testing all classes.
std::uint8_t ClassOf(const NumberCode& code, std::uint32_t number) {
  std::uint8_t c = 15;
  while (number < code.bases[c]) {
    --c;
  }
  return c;
}

TEST(ClassifyNumbersTest, EveryNumberHasItsClassOnEveryInstructionSet) {
  std::vector<std::uint32_t> depths;
  std::vector<std::uint32_t> colors;
  const auto add = [&](std::uint32_t depth, std::uint32_t color) {
    depths.push_back(depth);
    colors.push_back(color);
  };
  for (std::size_t c = 0; c < 16; ++c) {
    for (const std::uint32_t offset : {0U, 1U, 0xffffffffU}) {
      add(kDepthCode.bases[c] + offset, kColorCode.bases[15 - c] + offset);
    }
  }
  add(std::numeric_limits<std::uint32_t>::max(), 0x80000000U);
  add(0x7fffffffU, std::numeric_limits<std::uint32_t>::max());
  for (std::uint64_t i = 0; i < 5000; ++i) {
    const auto random = [i](std::uint64_t seed) {
      const double bits = 32 * base::RandomUnit(seed, 2 * i);
      return static_cast<std::uint32_t>(
          base::RandomUnit(seed, 2 * i + 1) *
          static_cast<double>(std::uint64_t{1} << static_cast<int>(bits)));
    };
    add(random(1), random(2));
  }
  const std::size_t count = depths.size();
  depths.resize(count + kClassifyPadding);
  colors.resize(count + kClassifyPadding);
  const absl::Cleanup restore = [] { hwy::SetSupportedTargetsForTest(0); };
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    for (const std::size_t size : {std::size_t{1}, std::size_t{15}, std::size_t{17}, count}) {
      std::vector<std::uint8_t> controls(size + kClassifyPadding);
      ClassifyNumbers(depths.data(), colors.data(), size, controls.data());
      for (std::size_t i = 0; i < size; ++i) {
        ASSERT_EQ(controls[i], ClassOf(kDepthCode, depths[i]) | ClassOf(kColorCode, colors[i]) << 4)
            << hwy::TargetName(target) << ": " << depths[i] << ", " << colors[i];
      }
    }
  }
}

}  // namespace
}  // namespace isoscope::composite
