#include "core/source/bytes/byte_order.h"

#include <string>

#include "gtest/gtest.h"

namespace isoscope::source {
namespace {

TEST(SwapBytesTest, EverySampleIsReversedAndNothingBehindIsTouched) {
  const auto swapped = [](std::size_t size, std::size_t count) {
    std::string bytes = "abcdefghijklmnopqr";
    SwapBytes(size, count, bytes.data());
    return bytes;
  };
  EXPECT_EQ(swapped(1, 18), "abcdefghijklmnopqr");
  EXPECT_EQ(swapped(2, 3), "badcfeghijklmnopqr");
  EXPECT_EQ(swapped(4, 2), "dcbahgfeijklmnopqr");
  EXPECT_EQ(swapped(8, 2), "hgfedcbaponmlkjiqr");
  EXPECT_EQ(swapped(8, 0), "abcdefghijklmnopqr");
}

}  // namespace
}  // namespace isoscope::source
