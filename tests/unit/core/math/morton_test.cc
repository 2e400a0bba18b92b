#include "core/math/morton.h"

#include <cstdint>

#include "gtest/gtest.h"

#include "core/base/random.h"

namespace isoscope::math {
namespace {

std::uint64_t InterleaveBitByBit(std::uint64_t x, std::uint64_t y, std::uint64_t z) {
  std::uint64_t code = 0;
  for (int bit = 0; bit < 21; ++bit) {
    code |= (x >> bit & 1) << (3 * bit) | (y >> bit & 1) << (3 * bit + 1) |
            (z >> bit & 1) << (3 * bit + 2);
  }
  return code;
}

TEST(MortonTest, InterleavesBitsWithXFastest) {
  EXPECT_EQ(MortonCode3(1, 0, 0), 1u);
  EXPECT_EQ(MortonCode3(0, 1, 0), 2u);
  EXPECT_EQ(MortonCode3(0, 0, 1), 4u);
  EXPECT_EQ(MortonCode3(3, 5, 1), 0b010'001'111u);
  constexpr std::int64_t kMax = (1 << 21) - 1;
  EXPECT_EQ(MortonCode3(kMax, kMax, kMax), ~std::uint64_t{0} >> 1);
}

TEST(MortonTest, EqualsBitByBitInterleaving) {
  for (std::uint64_t n = 0; n < 1000; ++n) {
    const std::uint64_t x = base::RandomBits(1, 3 * n) & 0x1fffff;
    const std::uint64_t y = base::RandomBits(1, 3 * n + 1) & 0x1fffff;
    const std::uint64_t z = base::RandomBits(1, 3 * n + 2) & 0x1fffff;
    EXPECT_EQ(MortonCode3(static_cast<std::int64_t>(x), static_cast<std::int64_t>(y),
                          static_cast<std::int64_t>(z)),
              InterleaveBitByBit(x, y, z));
  }
}

}  // namespace
}  // namespace isoscope::math
