#include "core/math/z_order.h"

#include <algorithm>
#include <cstdint>
#include <vector>

#include "gtest/gtest.h"

namespace isoscope::math {
namespace {

std::int64_t CodeOf(const Index3& index) {
  std::int64_t code = 0;
  for (int bit = 0; bit < 5; ++bit) {
    for (int axis = 0; axis < 3; ++axis) {
      code |= (index[axis] >> bit & 1) << (3 * bit + axis);
    }
  }
  return code;
}

TEST(ZOrderTest, IsTheOrderOfInterleavedBits) {
  std::vector<Index3> all;
  for (std::int64_t i = 0; i < 20 * 7 * 11; ++i) {
    all.push_back({i % 20, i / 20 % 7, i / 140});
  }
  for (const Index3& a : all) {
    for (const Index3& b : all) {
      ASSERT_EQ(IsBeforeInZOrder(a, b), CodeOf(a) < CodeOf(b))
          << a.x << " " << a.y << " " << a.z << ", " << b.x << " " << b.y << " " << b.z;
    }
  }
}

TEST(ZOrderTest, TakesLargeIndices) {
  constexpr std::int64_t kLarge = std::int64_t{1} << 62;
  EXPECT_TRUE(IsBeforeInZOrder({kLarge - 1, kLarge - 1, kLarge - 1}, {kLarge, 0, 0}));
  EXPECT_TRUE(IsBeforeInZOrder({kLarge, 0, 0}, {0, 0, kLarge}));
  EXPECT_FALSE(IsBeforeInZOrder({kLarge, 1, 0}, {kLarge, 1, 0}));
}

}  // namespace
}  // namespace isoscope::math
