#include "core/source/bytes/binary_header.h"

#include <cstdint>
#include <string>

#include "gtest/gtest.h"

namespace isoscope::source {
namespace {

TEST(BinaryHeaderTest, LoadsNumbersOfBothByteOrders) {
  const std::string bytes("\0\1\2\3\0\0\x80\x3f", 8);
  const BinaryHeader little(bytes, false);
  EXPECT_EQ(little.Load<std::int16_t>(0), 0x100);
  EXPECT_EQ(little.Load<float>(4), 1.0F);
  const BinaryHeader big(bytes, true);
  EXPECT_TRUE(big.is_big_endian());
  EXPECT_EQ(big.Load<std::int16_t>(0), 1);
  EXPECT_EQ(big.Load<std::uint32_t>(0), 0x00010203U);
  EXPECT_EQ(big.bytes(), bytes);
  EXPECT_TRUE(BeginsBigEndian(bytes, 0x00010203U));
  EXPECT_FALSE(BeginsBigEndian(bytes, 0x03020100U));
}

}  // namespace
}  // namespace isoscope::source
