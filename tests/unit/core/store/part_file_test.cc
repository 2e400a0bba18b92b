#include "core/store/part_file.h"

#include <limits>
#include <string>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::store {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

SeriesManifest SeriesOfTwoFields() {
  SeriesManifest series;
  series.name = "flow";
  series.source = "flow.pvd";
  series.geometry.sample_dims = {13, 11, 9};
  series.block_cells = {4, 4, 4};
  series.shard_count = 2;
  series.seed = 7;
  series.fields = {{.name = "p", .long_name = "pressure", .unit = "Pa", .components = {{}}},
                   {.name = "q \"x\"", .long_name = "", .unit = "", .components = {{}}}};
  series.times = {0.5, 1};
  return series;
}

PartCut CutOf(int index) {
  return {
      .part = {.index = index, .count = 3},
      .members = {{"--shards", "2"}, {"the source", "a \"quoted\" name"}},
      .name = "flow",
      .series = SeriesOfTwoFields(),
      .keys = {{.field = 0, .component = 0, .step = 0}, {.field = 1, .component = 0, .step = 1}}};
}

PieceRecord Record() {
  PieceRecord record;
  record.part = {.index = 2, .count = 3};
  record.cut_digest = CutOf(2).Digest();
  record.manifest.dataset_id = std::string(32, '0');
  record.manifest.name = "head";
  record.manifest.source = "head.nrrd";
  record.manifest.geometry.sample_dims = {9, 9, 9};
  record.manifest.block_cells = {4, 4, 4};
  record.manifest.shards = {{.block_count = 8}};
  record.highest_level = 2;
  record.level_filter = volume::LevelFilter::kMajority;
  record.compression = BlockEncoding::kZstd;
  record.digest_sum = {1, std::numeric_limits<std::uint64_t>::max(), 3, 4};
  record.value_range = {-1.5, std::numeric_limits<double>::infinity()};
  record.max_gradient_magnitude = 0.1;
  record.ranges_bytes = 80;
  record.ranges_crc32c = 0xDEADBEEF;
  record.level1_bytes = 64;
  record.level1_crc32c = 5;
  record.shards = {{.summary = {.block_count = 4, .block_bytes = 100, .block_index_crc32c = 6},
                    .spans_crc32c = 7,
                    .histogram_crc32c = 8},
                   {}};
  return record;
}

TEST(PartFileTest, NamesOfPartsAreReadBack) {
  for (const PartNumber part : {PartNumber{0, 1}, PartNumber{3, 16}, PartNumber{99'998, 99'999}}) {
    EXPECT_EQ(PartOfName(PartName(part)), part);
    EXPECT_EQ(PartOfName(PartName(part) + ".try-a8Xd3q"), part);
    EXPECT_EQ(PartOfName(PartName(part) + ".json"), part);
  }
  for (const char* name : {"", "part-", "part-00003-of-00003", "part-00003-of-", "volume",
                           "part-0000x-of-00003", "xpart-00001-of-00003", "part-+0001-of-00003"}) {
    EXPECT_EQ(PartOfName(name), std::nullopt) << name;
  }
}

TEST(PartFileTest, CutsAreReadBack) {
  const PartCut cut = CutOf(1);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const PartCut read, DecodePartCut(EncodePartCut(cut), "cut"));
  EXPECT_EQ(read.part, cut.part);
  EXPECT_EQ(read.members, cut.members);
  EXPECT_EQ(read.name, cut.name);
  EXPECT_EQ(read.series, cut.series);
  EXPECT_EQ(read.keys, cut.keys);
  EXPECT_EQ(read.Digest(), cut.Digest());
  PartCut plain = cut;
  plain.series.reset();
  plain.keys.clear();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const PartCut plain_read,
                                DecodePartCut(EncodePartCut(plain), "cut"));
  EXPECT_FALSE(plain_read.series.has_value());
}

TEST(PartFileTest, TheDigestIsOfAllButThePart) {
  EXPECT_EQ(CutOf(0).Digest(), CutOf(2).Digest());
  PartCut other = CutOf(0);
  other.members[0].second = "3";
  EXPECT_NE(other.Digest(), CutOf(0).Digest());
  other = CutOf(0);
  other.keys.pop_back();
  EXPECT_NE(other.Digest(), CutOf(0).Digest());
  other = CutOf(0);
  other.series->times[1] = 2;
  EXPECT_NE(other.Digest(), CutOf(0).Digest());
}

TEST(PartFileTest, RecordsAreReadBack) {
  const PieceRecord record = Record();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const PieceRecord read,
                                DecodePieceRecord(EncodePieceRecord(record), "piece"));
  EXPECT_EQ(read.part, record.part);
  EXPECT_EQ(read.cut_digest, record.cut_digest);
  EXPECT_EQ(read.manifest, record.manifest);
  EXPECT_EQ(read.highest_level, record.highest_level);
  EXPECT_EQ(read.level_filter, record.level_filter);
  EXPECT_EQ(read.compression, record.compression);
  EXPECT_EQ(read.digest_sum, record.digest_sum);
  EXPECT_EQ(read.value_range, record.value_range);
  EXPECT_EQ(read.finite_range, record.finite_range);
  EXPECT_EQ(read.max_gradient_magnitude, record.max_gradient_magnitude);
  EXPECT_EQ(read.ranges_bytes, record.ranges_bytes);
  EXPECT_EQ(read.ranges_crc32c, record.ranges_crc32c);
  EXPECT_EQ(read.level1_bytes, record.level1_bytes);
  EXPECT_EQ(read.level1_crc32c, record.level1_crc32c);
  EXPECT_EQ(read.shards, record.shards);
}

TEST(PartFileTest, ProgressIsReadBack) {
  const PartProgress progress{.phase = "writing blocks",
                              .done_bytes = 3,
                              .total_bytes = 9,
                              .host = "node-7",
                              .process_id = 4711,
                              .updated_unix_seconds = 1'795'000'000};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const PartProgress read,
                                DecodePartProgress(EncodePartProgress(progress), "progress"));
  EXPECT_EQ(read.phase, progress.phase);
  EXPECT_EQ(read.done_bytes, progress.done_bytes);
  EXPECT_EQ(read.total_bytes, progress.total_bytes);
  EXPECT_EQ(read.host, progress.host);
  EXPECT_EQ(read.process_id, progress.process_id);
  EXPECT_EQ(read.updated_unix_seconds, progress.updated_unix_seconds);
}

TEST(PartFileTest, DamagedAndForeignTextsAreRefused) {
  const std::string text = EncodePieceRecord(Record());
  for (std::size_t at = 0; at < text.size(); at += 7) {
    std::string damaged = text;
    damaged[at] = static_cast<char>(damaged[at] ^ 1);
    EXPECT_FALSE(DecodePieceRecord(damaged, "piece").ok()) << at;
    EXPECT_FALSE(DecodePieceRecord(text.substr(0, at), "piece").ok()) << at;
  }
  EXPECT_THAT(DecodePartCut(text, "d.partial/parts/part-00000-of-00003.json"),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("part-00000-of-00003.json")));
}

}  // namespace
}  // namespace isoscope::store
