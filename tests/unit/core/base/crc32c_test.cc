#include "core/base/crc32c.h"

#include <string>

#include "gtest/gtest.h"

namespace isoscope::base {
namespace {

// Source: RFC 3720, appendix B.4.
TEST(Crc32cTest, MatchesThePublishedVectors) {
  EXPECT_EQ(Crc32c(std::string(32, '\0')), 0x8a9136aau);
  EXPECT_EQ(Crc32c(std::string(32, '\xff')), 0x62a8ab43u);
  std::string ascending(32, '\0');
  std::string descending(32, '\0');
  for (std::size_t i = 0; i < 32; ++i) {
    ascending[i] = static_cast<char>(i);
    descending[i] = static_cast<char>(31 - i);
  }
  EXPECT_EQ(Crc32c(ascending), 0x46dd794eu);
  EXPECT_EQ(Crc32c(descending), 0x113fdb5cu);
  std::string read_command(48, '\0');  // an iSCSI read (10) command
  read_command[0] = '\x01';
  read_command[1] = '\xc0';
  read_command[16] = '\x14';
  read_command[22] = '\x04';
  read_command[27] = '\x14';
  read_command[31] = '\x18';
  read_command[32] = '\x28';
  read_command[40] = '\x02';
  EXPECT_EQ(Crc32c(read_command), 0xd9963a56u);
  EXPECT_EQ(Crc32c("123456789"), 0xe3069283u);
  EXPECT_EQ(Crc32c(""), 0u);
}

TEST(Crc32cTest, PiecesGiveTheSameAsTheWhole) {
  std::string bytes(300, '\0');
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    bytes[i] = static_cast<char>(i * 7);
  }
  const std::uint32_t whole = Crc32c(bytes);
  for (std::size_t cut = 0; cut <= bytes.size(); ++cut) {
    const std::uint32_t head = Crc32c(absl::string_view(bytes).substr(0, cut));
    EXPECT_EQ(ExtendCrc32c(head, bytes.data() + cut, bytes.size() - cut), whole);
  }
}

TEST(Crc32cTest, EverySizeAndAlignmentEqualsTheBitwiseDefinition) {
  std::string bytes(100, '\0');
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    bytes[i] = static_cast<char>(i * i + 3);
  }
  for (std::size_t begin = 0; begin < 9; ++begin) {
    for (std::size_t size = 0; size + begin <= bytes.size(); ++size) {
      std::uint32_t expected = 0xffffffff;
      for (std::size_t i = begin; i < begin + size; ++i) {
        expected ^= static_cast<unsigned char>(bytes[i]);
        for (int bit = 0; bit < 8; ++bit) {
          expected = (expected >> 1) ^ ((expected & 1) != 0 ? 0x82f63b78u : 0u);
        }
      }
      ASSERT_EQ(ExtendCrc32c(0, bytes.data() + begin, size), ~expected);
    }
  }
}

}  // namespace
}  // namespace isoscope::base
