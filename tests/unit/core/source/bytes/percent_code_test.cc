#include "core/source/bytes/percent_code.h"

#include <string>

#include "absl/strings/str_format.h"
#include "gtest/gtest.h"

namespace isoscope::source {
namespace {

TEST(PercentCodeTest, DecodesEveryByte) {
  for (int byte = 0; byte < 256; ++byte) {
    const std::string decoded(1, static_cast<char>(byte));
    for (const std::string& code :
         {absl::StrFormat("%%%02x", byte), absl::StrFormat("%%%02X", byte)}) {
      EXPECT_TRUE(IsPercentEncoded(code));
      EXPECT_EQ(PercentDecode(code), decoded) << code;
      EXPECT_EQ(PercentDecode("a" + code + "b" + code), "a" + decoded + "b" + decoded) << code;
    }
  }
  EXPECT_TRUE(IsPercentEncoded(""));
  EXPECT_TRUE(IsPercentEncoded("a b+c"));
  EXPECT_EQ(PercentDecode("a b+c"), "a b+c");
  EXPECT_EQ(PercentDecode("%2520"), "%20");  // once
}

// Also where a number would be read with a sign or a space.
TEST(PercentCodeTest, APercentThatBeginsNoCodeStays) {
  for (const char* const text :
       {"%", "100%", "%4", "a%zz", "%4g", "%g4", "%+4", "% 4", "%-1", "%0x", "%%", "%\xc3\xa9"}) {
    EXPECT_FALSE(IsPercentEncoded(text)) << text;
    EXPECT_EQ(PercentDecode(text), text);
  }
  EXPECT_FALSE(IsPercentEncoded("%20%"));
  EXPECT_EQ(PercentDecode("%%41"), "%A");
}

}  // namespace
}  // namespace isoscope::source
