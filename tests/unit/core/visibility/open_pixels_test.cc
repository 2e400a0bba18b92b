#include "core/visibility/open_pixels.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/crc32c.h"
#include "core/base/random.h"
#include "core/visibility/occlusion_map.h"
#include "tests/support/status_matchers.h"

namespace isoscope::visibility {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::_;
using ::testing::HasSubstr;

constexpr std::size_t kHeaderSize = 24;

std::vector<view::PixelRect> RandomRects(std::size_t count, std::uint64_t seed, int largest) {
  std::vector<view::PixelRect> rects;
  for (std::uint64_t i = 0; i < count; ++i) {
    const auto random = [&](std::uint64_t k, int below) {
      return static_cast<int>(base::RandomBits(seed, 4 * i + k) %
                              static_cast<std::uint64_t>(below));
    };
    const int x = random(0, 500);
    const int y = random(1, 500);
    rects.push_back({x, y, x + random(2, largest), y + random(3, largest)});  // some are empty
  }
  return rects;
}

// Each cell open with this probability.
std::vector<image::PixelMask> RandomMasks(const std::vector<view::PixelRect>& rects,
                                          std::uint64_t seed, double open_share) {
  std::vector<image::PixelMask> masks;
  std::uint64_t counter = 0;
  for (const view::PixelRect& rect : rects) {
    masks.push_back(ClosedMaskOf(rect));
    image::PixelMask& mask = masks.back();
    for (std::size_t bit = 0; bit < static_cast<std::size_t>(mask.columns * mask.rows); ++bit) {
      const bool is_open = base::RandomUnit(seed, counter++) < open_share;
      mask.words[bit / 64] |= std::uint64_t{is_open} << (bit % 64);
    }
  }
  return masks;
}

TEST(OpenPixelsTest, EveryListComesBack) {
  for (const std::size_t count : std::vector<std::size_t>{0, 1, 2, 3, 50, 1000}) {
    for (const int largest : {2, 9, 40, 300}) {
      for (const double open_share : {0.0, 0.02, 0.5, 1.0}) {
        const auto rects = RandomRects(count, count + static_cast<std::size_t>(largest), largest);
        const auto masks = RandomMasks(rects, 5, open_share);
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto back,
                                      DecodeOpenPixels(EncodeOpenPixels(masks), rects));
        ASSERT_EQ(back, masks) << count << " masks, " << largest << ", " << open_share;
      }
    }
  }
}

// docs/format/wire.md: sender and receiver derive the shapes, so both must count to the same 32.
TEST(OpenPixelsTest, AMaskHasThe32ColumnsAndRowsOfTheWireFormat) {
  struct Case {
    view::PixelRect rect;
    int shift;
    int columns;
    int rows;
  };
  for (const Case& c : std::vector<Case>{{{0, 0, 32, 32}, 0, 32, 32},
                                         {{5, 7, 37, 8}, 0, 32, 1},
                                         {{0, 0, 33, 1}, 1, 17, 1},
                                         {{1, 0, 64, 3}, 1, 32, 2},
                                         {{1, 0, 65, 3}, 2, 17, 1},
                                         {{0, 96, 4, 608}, 4, 1, 32}}) {
    const image::PixelMask mask = ClosedMaskOf(c.rect);
    EXPECT_EQ(mask.shift, c.shift) << c.rect.end_x;
    EXPECT_EQ(mask.columns, c.columns) << c.rect.end_x;
    EXPECT_EQ(mask.rows, c.rows) << c.rect.end_x;
  }
  // 25 x 2 cells: 50 bits, which are 7 bytes, stored as they are.
  const view::PixelRect rect{3, 0, 28, 2};
  image::PixelMask mask = ClosedMaskOf(rect);
  ASSERT_EQ(mask.words.size(), 1U);
  mask.words[0] = 0x2'0000'0300'0001;
  const std::string bytes = EncodeOpenPixels({&mask, 1});
  ASSERT_EQ(bytes.size(), kHeaderSize + 7);
  EXPECT_EQ(bytes.substr(kHeaderSize), std::string("\x01\0\0\x03\0\0\x02", 7));
}

TEST(OpenPixelsTest, CostsABitACellAtMostAndLittleWhereCellsAgree) {
  const auto rects = RandomRects(1000, 1, 30);
  std::size_t bits = 0;
  for (const view::PixelRect& rect : rects) {
    const image::PixelMask mask = ClosedMaskOf(rect);
    bits += static_cast<std::size_t>(mask.columns * mask.rows);
  }
  EXPECT_LE(EncodeOpenPixels(RandomMasks(rects, 2, 0.5)).size(), kHeaderSize + (bits + 7) / 8);
  EXPECT_LT(EncodeOpenPixels(RandomMasks(rects, 2, 1.0)).size(), kHeaderSize + 100);
}

TEST(OpenPixelsTest, EveryTruncationAndBitFlipIsDataLoss) {
  const auto rects = RandomRects(12, 7, 20);
  for (const double open_share : {0.5, 0.02}) {  // stored, compressed
    std::string bytes = EncodeOpenPixels(RandomMasks(rects, 3, open_share));
    for (std::size_t size = 0; size < bytes.size(); ++size) {
      // An allocation of exactly this size, so that a sanitizer sees a read past it.
      const std::string cut(bytes.data(), size);
      ASSERT_THAT(DecodeOpenPixels(cut, rects), StatusIs(absl::StatusCode::kDataLoss, _)) << size;
    }
    EXPECT_THAT(DecodeOpenPixels(bytes + "x", rects), StatusIs(absl::StatusCode::kDataLoss, _));
    for (std::size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
      bytes[bit / 8] = static_cast<char>(bytes[bit / 8] ^ (1 << (bit % 8)));
      ASSERT_THAT(DecodeOpenPixels(bytes, rects), StatusIs(absl::StatusCode::kDataLoss, _)) << bit;
      bytes[bit / 8] = static_cast<char>(bytes[bit / 8] ^ (1 << (bit % 8)));
    }
  }
}

// A hostile sender can compute the checksum, so the content is checked as well.
std::string Sealed(std::string bytes) {
  base::StoreLittleEndian(base::ExtendCrc32c(0, bytes.data() + 8, bytes.size() - 8),
                          bytes.data() + 4);
  return bytes;
}

TEST(OpenPixelsTest, DamageBehindAValidChecksumIsRefusedOrHasTheRightShapes) {
  const auto rects = RandomRects(12, 7, 20);
  for (const double open_share : {0.5, 0.02}) {
    const auto masks = RandomMasks(rects, 3, open_share);
    const std::string bytes = EncodeOpenPixels(masks);
    for (std::size_t byte = 8; byte < bytes.size(); ++byte) {
      std::string damaged = bytes;
      damaged[byte] = static_cast<char>(damaged[byte] ^ 0x11);
      const auto back = DecodeOpenPixels(Sealed(damaged), rects);
      if (byte < kHeaderSize) {
        EXPECT_THAT(back, StatusIs(absl::StatusCode::kDataLoss, _)) << "byte " << byte;
      } else if (back.ok()) {
        EXPECT_NE(*back, masks);
        ASSERT_EQ(back->size(), masks.size());
      } else {
        EXPECT_THAT(back, StatusIs(absl::StatusCode::kDataLoss, _));
      }
    }
    for (std::size_t size = kHeaderSize; size < bytes.size(); ++size) {
      EXPECT_THAT(DecodeOpenPixels(Sealed(bytes.substr(0, size)), rects),
                  StatusIs(absl::StatusCode::kDataLoss, _));
    }
    EXPECT_THAT(DecodeOpenPixels(Sealed(bytes + 'x'), rects),
                StatusIs(absl::StatusCode::kDataLoss, _));
  }
}

TEST(OpenPixelsTest, BitsAfterTheLastMaskAreRefused) {
  const std::vector<view::PixelRect> rects{{0, 0, 3, 1}};
  std::string bytes = EncodeOpenPixels(RandomMasks(rects, 1, 1.0));
  ASSERT_EQ(bytes.size(), kHeaderSize + 1);
  EXPECT_EQ(bytes.back(), 7);
  ISOSCOPE_EXPECT_OK(DecodeOpenPixels(bytes, rects));
  bytes.back() = 15;
  EXPECT_THAT(DecodeOpenPixels(Sealed(bytes), rects), StatusIs(absl::StatusCode::kDataLoss, _));
}

TEST(OpenPixelsTest, MasksOfOtherRectanglesAreRefused) {
  const std::vector<view::PixelRect> rects{{0, 0, 10, 10}, {5, 5, 7, 7}};
  const std::string bytes = EncodeOpenPixels(RandomMasks(rects, 1, 0.5));
  EXPECT_THAT(
      DecodeOpenPixels(bytes, std::vector<view::PixelRect>{rects[0]}),
      StatusIs(absl::StatusCode::kDataLoss, HasSubstr("2 masks with 104 bits; expected 1")));
  EXPECT_THAT(DecodeOpenPixels(bytes, std::vector<view::PixelRect>{rects[0], {5, 5, 8, 7}}),
              StatusIs(absl::StatusCode::kDataLoss, _));
}

}  // namespace
}  // namespace isoscope::visibility
