#include "core/composite/band_format.h"

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/crc32c.h"
#include "tests/support/status_matchers.h"

namespace isoscope::composite {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

constexpr int kWidth = 100;
constexpr int kHeight = 50;
constexpr BandHeader kHeader = {.begin_row = 1,
                                .row_count = 2,
                                .pixel_count = 300,
                                .tile_count = 4,
                                .dictionary_count = 5,
                                .label_count = 6,
                                .palette_size = 7,
                                .frame_size = 8,
                                .extras_size = 9};

std::string MakeBand(const BandHeader& header, int width = kWidth, int height = kHeight) {
  std::string band = MakeBandHeader(header, width, height);
  band.append(header.frame_size + header.pixel_count + header.extras_size, 'x');
  SealBand(&band);
  return band;
}

// The bytes of docs/format/wire.md. Any other header would be another format.
TEST(BandFormatTest, HeaderHasTheBytesThatTheDocumentStates) {
  const std::string band = MakeBand(kHeader);
  EXPECT_EQ(band.substr(0, 4), "ISPX");
  EXPECT_EQ(base::LoadLittleEndian<std::uint32_t>(band.data() + 4), base::Crc32c(band.substr(8)));
  EXPECT_EQ(band.substr(8, 4), std::string("\x02\0\0\0", 4));
  const std::vector<std::uint32_t> expected = {100, 50, 1, 2, 300, 4, 5, 6, 7, 8, 9};
  for (std::size_t i = 0; i < expected.size(); ++i) {
    EXPECT_EQ(base::LoadLittleEndian<std::uint32_t>(band.data() + 12 + 4 * i), expected[i]) << i;
  }
}

TEST(BandFormatTest, HeaderIsReadBack) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const BandHeader header,
      ReadBandHeader(MakeBand(kHeader), image::FrameImage(kWidth, kHeight)));
  EXPECT_EQ(header.begin_row, 1);
  EXPECT_EQ(header.row_count, 2);
  EXPECT_EQ(header.pixel_count, 300U);
  EXPECT_EQ(header.tile_count, 4U);
  EXPECT_EQ(header.dictionary_count, 5U);
  EXPECT_EQ(header.label_count, 6U);
  EXPECT_EQ(header.palette_size, 7U);
  EXPECT_EQ(header.frame_size, 8U);
  EXPECT_EQ(header.extras_size, 9U);
}

TEST(BandFormatTest, HeaderThatCanNotBeIsDataLossSayingWhy) {
  const image::FrameImage image(kWidth, kHeight);  // 4 rows of tiles
  const auto expect = [&](const std::string& band, const char* why) {
    EXPECT_THAT(ReadBandHeader(band, image), StatusIs(absl::StatusCode::kDataLoss, HasSubstr(why)));
  };
  const auto changed = [](auto change) {
    BandHeader header = kHeader;
    change(&header);
    return MakeBand(header);
  };
  expect("", "no header");
  expect("ISPY" + MakeBand(kHeader).substr(4), "magic");
  std::string unsealed = MakeBand(kHeader);
  unsealed.back() = 'y';
  expect(unsealed, "CRC-32C");
  expect(MakeBand(kHeader, kWidth + 1, kHeight), "expected 100 x 50");
  expect(MakeBand(kHeader, kWidth, kHeight - 1), "expected 100 x 50");
  expect(changed([](BandHeader* h) { h->begin_row = 3; }), "the image has 4");
  expect(changed([](BandHeader* h) { h->begin_row = 4, h->row_count = 1; }), "the image has 4");
  expect(changed([](BandHeader* h) { h->row_count = 0; }), "the image has 4");
  expect(changed([](BandHeader* h) { h->tile_count = 0; }), "0 tiles");
  expect(changed([](BandHeader* h) { h->tile_count = 1; }), "1 tiles, 300 pixels");
  expect(changed([](BandHeader* h) { h->dictionary_count = 3; }), "3 dictionary entries");
  expect(changed([](BandHeader* h) { h->label_count = 301; }), "301 labels");
  expect(changed([](BandHeader* h) { h->palette_size = kMaxPaletteSize + 1; }), "2049 colours");
  expect(changed([](BandHeader* h) { h->extras_size = kBandPaddingBytes - 1; }),
         "7 bytes of extra");
  std::string longer = MakeBand(kHeader) + "x";
  SealBand(&longer);
  expect(longer, "its header states");
}

TEST(BandFormatTest, NumbersAreFourPlanesOfZigZagDifferences) {
  std::string planes;
  AppendNumbers({3, 1, 0x01020304}, &planes);
  // 6, 3 and 2 * 0x01020303 = 0x02040606, lowest bytes first.
  EXPECT_EQ(planes, std::string("\x06\x03\x06\0\0\x06\0\0\x04\0\0\x02", 12));
  EXPECT_EQ(ReadNumbers(planes, 3), (std::vector<std::uint32_t>{3, 1, 0x01020304}));
}

TEST(BandFormatTest, NumbersOfTheWholeRangeAreReadBack) {
  const std::vector<std::uint32_t> numbers = {0, 0xffffffff, 0, 0x80000000, 0x7fffffff, 1};
  std::string planes = "before";
  AppendNumbers(numbers, &planes);
  EXPECT_EQ(ReadNumbers(absl::string_view(planes).substr(6), numbers.size()), numbers);
  std::string none;
  AppendNumbers({}, &none);
  EXPECT_EQ(none, "");
  EXPECT_TRUE(ReadNumbers("", 0).empty());
}

TEST(BandFormatTest, ColorsAndNumbersAreInverse) {
  constexpr image::Rgba8 kColor = {1, 2, 3, 4};
  static_assert(image::PackedColor(kColor) == 0x01020304 && ColorOf(0x01020304) == kColor);
  EXPECT_LT(image::PackedColor({1, 255, 255, 255}), image::PackedColor({2, 0, 0, 0}))
      << "red first";
}

TEST(BandFormatTest, TilesAtTheEdgesArePartlyInside) {
  const image::FrameImage image(kWidth, kHeight);
  const TileArea corner = AreaOf(6, 3, image);
  EXPECT_EQ(corner.x, 96);
  EXPECT_EQ(corner.y, 48);
  EXPECT_EQ(corner.columns, 4);
  EXPECT_EQ(corner.rows, 2);
  EXPECT_EQ(AreaOf(0, 0, image).columns, 16);
}

}  // namespace
}  // namespace isoscope::composite
