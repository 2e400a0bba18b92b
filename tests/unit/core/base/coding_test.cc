#include "core/base/coding.h"

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "gtest/gtest.h"

namespace isoscope::base {
namespace {

TEST(CodingTest, BytesAreLittleEndian) {
  std::string out;
  AppendLittleEndian(std::uint8_t{0xab}, &out);
  AppendLittleEndian(std::uint16_t{0x0123}, &out);
  AppendLittleEndian(std::int32_t{-2}, &out);
  AppendLittleEndian(std::uint64_t{0x0123456789abcdef}, &out);
  AppendLittleEndian(1.5f, &out);
  AppendLittleEndian(-2.0, &out);
  EXPECT_EQ(out, std::string("\xab"
                             "\x23\x01"
                             "\xfe\xff\xff\xff"
                             "\xef\xcd\xab\x89\x67\x45\x23\x01"
                             "\x00\x00\xc0\x3f"
                             "\x00\x00\x00\x00\x00\x00\x00\xc0",
                             27));
}

TEST(CodingTest, DecoderReadsWhatWasWrittenAtAnyAlignment) {
  for (std::size_t shift = 0; shift < 8; ++shift) {
    std::string out(shift, 'x');
    AppendLittleEndian(std::numeric_limits<std::int64_t>::min(), &out);
    AppendLittleEndian(std::numeric_limits<double>::infinity(), &out);
    out += "text";
    Decoder decoder(absl::string_view(out).substr(shift));
    std::int64_t integer = 0;
    double real = 0;
    absl::string_view text;
    ASSERT_TRUE(decoder.Read(&integer));
    ASSERT_TRUE(decoder.Read(&real));
    ASSERT_TRUE(decoder.ReadBytes(4, &text));
    EXPECT_EQ(integer, std::numeric_limits<std::int64_t>::min());
    EXPECT_TRUE(std::isinf(real));
    EXPECT_EQ(text, "text");
    EXPECT_EQ(decoder.remaining(), 0u);
  }
}

TEST(CodingTest, EveryTruncationFailsWithoutReadingOver) {
  for (std::size_t size = 0; size < 12; ++size) {
    const std::vector<char> exact(size, '\1');  // so that a sanitizer sees a read past the end
    Decoder decoder({exact.data(), exact.size()});
    std::uint32_t first = 7;
    std::uint64_t second = 7;
    const bool has_first = decoder.Read(&first);
    EXPECT_EQ(has_first, size >= 4);
    EXPECT_EQ(first, size >= 4 ? 0x01010101u : 7u);
    EXPECT_FALSE(decoder.Read(&second));
    EXPECT_EQ(second, 7u);
  }
}

TEST(CodingTest, NothingIsReadAfterAFailure) {
  const std::string bytes(6, '\1');
  Decoder decoder(bytes);
  std::uint64_t too_large = 0;
  EXPECT_FALSE(decoder.Read(&too_large));
  std::uint8_t small = 7;
  EXPECT_FALSE(decoder.Read(&small));
  EXPECT_EQ(small, 7);
  absl::string_view none;
  EXPECT_FALSE(decoder.ReadBytes(0, &none));
  EXPECT_EQ(decoder.remaining(), 0u);
}

}  // namespace
}  // namespace isoscope::base
