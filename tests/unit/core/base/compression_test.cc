#include "core/base/compression.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "tests/support/status_matchers.h"

namespace isoscope::base {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::_;
using ::testing::HasSubstr;

std::string SomeText() {
  std::string text;
  for (std::uint64_t i = 0; i < 2000; ++i) {
    text.push_back(static_cast<char>('a' + RandomBits(3, i) % 4));
  }
  return text;
}

TEST(CompressionTest, EverySizeComesBack) {
  const std::string text = SomeText();
  for (const std::size_t size : {0u, 1u, 2u, 100u, 2000u}) {
    const std::string bytes = text.substr(0, size);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string back, Decompress(Compress(bytes), size));
    EXPECT_EQ(back, bytes);
  }
  EXPECT_LT(Compress(text).size(), text.size() / 2);
}

TEST(CompressionTest, LargerThanExpectedIsRefusedBeforeAnythingIsAllocated) {
  const std::string frame = Compress(std::string(1 << 20, 'x'));
  EXPECT_LT(frame.size(), 1000u);
  EXPECT_THAT(Decompress(frame, (1 << 20) - 1),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("1048576")));
  // A header that states 2^60 bytes: magic, descriptor (8-byte size, single segment), size.
  const std::string huge("\x28\xb5\x2f\xfd\xe0\x00\x00\x00\x00\x00\x00\x00\x10\x01\x00\x00", 16);
  EXPECT_THAT(Decompress(huge, 1 << 20), StatusIs(absl::StatusCode::kDataLoss, _));
}

TEST(CompressionTest, FrameWithoutItsSizeIsRefused) {
  // Magic, descriptor (no size, no single segment), window, one empty last block.
  const std::string frame("\x28\xb5\x2f\xfd\x00\x00\x01\x00\x00", 9);
  EXPECT_THAT(Decompress(frame, 100),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("content size")));
}

TEST(CompressionTest, EveryTruncationAndAnythingAfterTheFrameIsRefused) {
  const std::string frame = Compress(SomeText());
  for (std::size_t size = 0; size < frame.size(); ++size) {
    const std::vector<char> exact(frame.begin(), frame.begin() + static_cast<std::ptrdiff_t>(size));
    ASSERT_THAT(Decompress({exact.data(), exact.size()}, 4000),
                StatusIs(absl::StatusCode::kDataLoss, _));
  }
  EXPECT_THAT(Decompress(frame + '\0', 4000), StatusIs(absl::StatusCode::kDataLoss, _));
  EXPECT_THAT(Decompress(frame + frame, 4000), StatusIs(absl::StatusCode::kDataLoss, _));
}

TEST(CompressionTest, FlippedBitsNeverGiveMoreThanWasAllowed) {
  const std::string text = SomeText();
  const std::string frame = Compress(text);
  for (std::size_t bit = 0; bit < 8 * frame.size(); ++bit) {
    std::string damaged = frame;
    damaged[bit / 8] =
        static_cast<char>(static_cast<unsigned char>(damaged[bit / 8]) ^ (1u << (bit % 8)));
    const auto result = Decompress(damaged, text.size());
    if (result.ok()) {  // messages carry a checksum of their own where it matters
      EXPECT_LE(result->size(), text.size());
    } else {
      EXPECT_EQ(result.status().code(), absl::StatusCode::kDataLoss);
    }
  }
}

}  // namespace
}  // namespace isoscope::base
