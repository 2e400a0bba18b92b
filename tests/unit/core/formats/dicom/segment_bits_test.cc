#include "core/formats/dicom/segment_bits.h"

#include <cstdint>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::testing::ElementsAre;
using volume::ScalarType;

TEST(SegmentBitsTest, BitsOfAnyBeginningAndCountAreThoseOfTheFile) {
  const testing::TempDir dir;
  const std::string bytes = testing::Noise({40, 1, 1}, ScalarType::kUint8);
  testing::WriteFile(dir.Sub("bits"), "xyz" + bytes);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, io::OpenRandomAccessFile(dir.Sub("bits")));
  for (const std::int64_t first : {0, 1, 7, 8, 13, 64, 100}) {
    for (const std::int64_t count : {1, 7, 8, 63, 64, 65, 128, 200}) {
      SegmentWords words{~std::uint64_t{0}};
      ISOSCOPE_ASSERT_OK(ReadSegmentBits(*file, 3, first, count, &words));
      ASSERT_EQ(words.size(), static_cast<std::size_t>((count + 63) / 64));
      for (std::int64_t i = 0; i < static_cast<std::int64_t>(64 * words.size()); ++i) {
        const auto at = static_cast<std::size_t>(first + i);
        const int expected =
            i < count ? static_cast<unsigned char>(bytes[at / 8]) >> (at % 8) & 1 : 0;
        ASSERT_EQ(words[static_cast<std::size_t>(i / 64)] >> (i % 64) & 1,
                  static_cast<std::uint64_t>(expected))
            << first << ", " << count << ", " << i;
      }
    }
  }
  SegmentWords words;
  ISOSCOPE_EXPECT_OK(ReadSegmentBits(*file, 3, 319, 1, &words));
  EXPECT_THAT(ReadSegmentBits(*file, 3, 319, 2, &words),
              testing::StatusIs(absl::StatusCode::kDataLoss));
}

TEST(SegmentBitsTest, LayersKeepSegmentsApartThatOverlapAnywhere) {
  SegmentOverlaps overlaps(5);
  EXPECT_THAT(overlaps.Layers(), ElementsAre(0, 0, 0, 0, 0));
  // 0 and 2 meet in the second word, 2 and 3 in the first; 1 touches nobody, 4 is elsewhere.
  overlaps.Add({{.segment = 2, .words = {1, 6}}, {.segment = 0, .words = {2, 4}}});
  overlaps.Add({{.segment = 1, .words = {8, 0}},
                {.segment = 3, .words = {1, 0}},
                {.segment = 2, .words = {1, 0}}});
  overlaps.Add({{.segment = 4, .words = {1, 1}}});
  EXPECT_THAT(overlaps.Layers(), ElementsAre(0, 0, 1, 0, 0));
  overlaps.Add({{.segment = 3, .words = {0, 1}}, {.segment = 0, .words = {0, 3}}});
  EXPECT_THAT(overlaps.Layers(), ElementsAre(0, 0, 1, 2, 0));
}

}  // namespace
}  // namespace isoscope::source
