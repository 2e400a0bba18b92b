#include "core/store/histogram_file.h"

#include <limits>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/crc32c.h"
#include "tests/support/status_matchers.h"

namespace isoscope::store {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;
using volume::ScalarType;

volume::SampleHistogram Example() {
  return {.bins = {.exponent = 1, .first = -3, .count = 2},
          .counts = {7, 258},
          .nan_count = 0,
          .negative_infinity_count = 0,
          .positive_infinity_count = 0};
}

// A file of these entries with right checksums.
std::string FileOf(const std::vector<std::int64_t>& entries, ScalarType type = ScalarType::kInt16,
                   std::uint32_t entry_size = 8) {
  std::string payload;
  for (const std::int64_t entry : entries) {
    base::AppendLittleEndian(entry, &payload);
  }
  return EncodeBinaryHeader(kHistogramMagic,
                            {.scalar_type = static_cast<std::uint32_t>(type),
                             .entry_size = entry_size,
                             .count = static_cast<std::int64_t>(payload.size() / entry_size),
                             .payload_crc32c = base::Crc32c(payload)}) +
         payload;
}

TEST(HistogramFileTest, TheBytesAreThoseOfTheDocument) {
  const std::string bytes = EncodeHistogram(ScalarType::kInt16, Example());
  const unsigned char expected[] = {
      0x49, 0x53, 0x4f, 0x48, 0x49, 0x53, 0x54, 0x4f, 0x01, 0x00, 0x00, 0x00, 0x5e, 0x17, 0x11,
      0x70, 0x04, 0x00, 0x00, 0x00, 0x08, 0x00, 0x00, 0x00, 0x07, 0x00, 0x00, 0x00, 0x00, 0x00,
      0x00, 0x00, 0x15, 0x30, 0x7f, 0xdc, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
      0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
      0x00, 0x00, 0x00, 0x00, 0x01, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0xfd, 0xff, 0xff,
      0xff, 0xff, 0xff, 0xff, 0xff, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
      0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x07,
      0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x02, 0x01, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00};
  EXPECT_EQ(bytes, std::string(reinterpret_cast<const char*>(expected), sizeof(expected)));
  EXPECT_EQ(bytes, FileOf({1, -3, 0, 0, 0, 7, 258}));
}

TEST(HistogramFileTest, EveryHistogramComesBack) {
  volume::SampleHistogram histogram;
  histogram.bins = {.exponent = -1000, .first = -(std::int64_t{1} << 53), .count = 4096};
  histogram.counts.assign(4096, std::int64_t{1} << 40);
  histogram.nan_count = 1;
  histogram.negative_infinity_count = 2;
  histogram.positive_infinity_count = std::int64_t{1} << 60;
  for (const volume::SampleHistogram& h : {histogram, volume::SampleHistogram{}}) {
    const std::string bytes = EncodeHistogram(ScalarType::kFloat64, h);
    EXPECT_LE(static_cast<std::int64_t>(bytes.size()), kMaxHistogramFileBytes);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto decoded,
                                  DecodeHistogram(bytes, ScalarType::kFloat64, "h"));
    EXPECT_EQ(decoded, h);
  }
}

TEST(HistogramFileTest, EveryCutAndEveryFlippedBitIsNoticed) {
  const std::string bytes = EncodeHistogram(ScalarType::kInt16, Example());
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_THAT(DecodeHistogram(bytes.substr(0, size), ScalarType::kInt16, "h"),
                StatusIs(absl::StatusCode::kDataLoss))
        << size;
  }
  EXPECT_FALSE(DecodeHistogram(bytes + "12345678", ScalarType::kInt16, "h").ok());
  for (std::size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
    std::string flipped = bytes;
    flipped[bit / 8] = static_cast<char>(flipped[bit / 8] ^ (1 << bit % 8));
    EXPECT_FALSE(DecodeHistogram(flipped, ScalarType::kInt16, "h").ok()) << bit;
  }
}

TEST(HistogramFileTest, ValuesThatNoHistogramHasAreDamageWhateverTheChecksumSays) {
  constexpr std::int64_t kHuge = std::numeric_limits<std::int64_t>::max();
  const std::vector<std::vector<std::int64_t>> hostile = {
      {1, -3, 0, 0},                // no room for the numbers in front
      {-1, -3, 0, 0, 0, 7},         // bins finer than integers
      {1015, 0, 0, 0, 0, 7},        // wider than all doubles
      {kHuge, 0, 0, 0, 0, 7},       // no int
      {-kHuge - 1, 0, 0, 0, 0, 7},  //
      {0, kHuge, 0, 0, 0, 7},       // the edge of the bin is no double
      {0, -(std::int64_t{1} << 53) - 1, 0, 0, 0, 7},
      {0, 0, -1, 0, 0, 7},  // counts below 0
      {0, 0, 0, -1, 0, 7},
      {0, 0, 0, 0, -1, 7},
      {0, 0, 0, 0, 0, -7},
      {0, 0, 0, 0, 0, kHuge},  // more samples than any volume has
      {0, 0, kHuge / 2, kHuge / 2, kHuge / 2, 7}};
  for (const std::vector<std::int64_t>& entries : hostile) {
    EXPECT_THAT(DecodeHistogram(FileOf(entries), ScalarType::kInt16, "h.bin"),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr("h.bin")))
        << ::testing::PrintToString(entries);
  }
  std::vector<std::int64_t> long_one(5 + 4097);
  EXPECT_THAT(DecodeHistogram(FileOf(long_one), ScalarType::kInt16, "h"),
              StatusIs(absl::StatusCode::kDataLoss));
  const std::vector<std::int64_t> good = {0, 0, 0, 0, 0, 7};
  EXPECT_THAT(DecodeHistogram(FileOf(good), ScalarType::kUint8, "h"),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("sample type")));
  EXPECT_THAT(DecodeHistogram(FileOf(good, ScalarType::kInt16, 16), ScalarType::kInt16, "h"),
              StatusIs(absl::StatusCode::kDataLoss));
}

}  // namespace
}  // namespace isoscope::store
