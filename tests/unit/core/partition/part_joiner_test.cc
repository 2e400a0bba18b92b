// Datasets that were cut in parts (part_writer.h) and joined, compared with those of one process,
// byte for byte.

#include "core/partition/part_joiner.h"

#include <cmath>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/partition/part_folder.h"
#include "core/partition/part_writer.h"
#include "core/partition/series_partitioner.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/core/partition/partitioner_fixture.h"
#include "tests/unit/core/partition/series_fixture.h"

namespace isoscope::partition {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;
using Files = std::map<std::string, std::string>;

class PartJoinerTest : public PartitionerTest {
 protected:
  // One scalar volume without a time, so no series.
  static MemorySeries OneVolume(const math::Index3& dims, volume::ScalarType type) {
    MemorySeries series({{.name = "p", .long_name = "", .unit = "", .components = {""}}}, {});
    series.geometry.sample_dims = dims;
    series.type_of = [type](int, int, int) { return type; };
    return series;
  }

  PartitionOptions Cut(const std::string& folder) {
    std::filesystem::create_directories(dir_.Sub(folder));
    PartitionOptions options = Options(folder + "/d");
    options.block_cells = {4, 3, 2};
    options.shard_count = 3;
    options.seed = 5;
    options.levels.highest = 2;
    return options;
  }

  absl::Status CutPart(source::VolumeSeries& source, const PartitionOptions& options, int index,
                       int count, const std::string& source_name = "a") {
    return PartitionPart(source,
                         {.volume = options,
                          .part = {.index = index, .count = count},
                          .source_members = {{"the source", source_name}}},
                         never_)
        .status();
  }

  // Cuts all parts, from the last to the first, and joins them.
  Files InParts(source::VolumeSeries& source, PartitionOptions options, int count) {
    std::filesystem::remove_all(dir_.Sub("many"));
    options.output_directory = Cut("many").output_directory;
    for (int index = count; index-- > 0;) {
      EXPECT_EQ(CutPart(source, options, index, count), absl::OkStatus());
    }
    EXPECT_EQ(JoinParts(options.output_directory,
                        {.memory_limit_bytes = options.memory_limit_bytes,
                         // Odd numbers are joined past the page cache.
                         .max_cached_bytes = count % 2 == 1 ? 0 : std::int64_t{1} << 40},
                        never_)
                  .status(),
              absl::OkStatus());
    EXPECT_THAT(EntriesOf(dir_.Sub("many")), ::testing::ElementsAre("d"));
    return FilesBelow(options.output_directory);
  }

  // The dataset of one process.
  Files InOne(source::VolumeSeries& source, PartitionOptions options) {
    std::filesystem::remove_all(dir_.Sub("one"));
    options.output_directory = Cut("one").output_directory;
    if (NeedsSeries(source)) {
      EXPECT_EQ(PartitionSeries(source, {.volume = options}, never_).status(), absl::OkStatus());
    } else {
      const auto volume = source.Open(0, 0, 0);
      EXPECT_EQ(Partition(**volume, options, never_).status(), absl::OkStatus());
    }
    return FilesBelow(options.output_directory);
  }

  void ExpectAlike(source::VolumeSeries& source, const PartitionOptions& options,
                   const std::vector<int>& counts) {
    const Files expected = InOne(source, options);
    ASSERT_FALSE(expected.empty());
    for (const int count : counts) {
      const Files files = InParts(source, options, count);
      ASSERT_EQ(files.size(), expected.size()) << count;
      for (const auto& [path, content] : expected) {
        EXPECT_TRUE(files.at(path) == content) << count << " parts: " << path;
      }
    }
  }
};

TEST_F(PartJoinerTest, BytesAreThoseOfOneProcessForEveryTypeAndNumberOfParts) {
  for (const volume::ScalarType type :
       {volume::ScalarType::kUint8, volume::ScalarType::kInt16, volume::ScalarType::kUint32,
        volume::ScalarType::kFloat32, volume::ScalarType::kFloat64}) {
    MemorySeries source = OneVolume({17, 14, 35}, type);
    ExpectAlike(source, Cut("many"), {1, 2, 5, 16});
  }
}

TEST_F(PartJoinerTest, BytesAreThoseOfOneProcessForCompressedBlocksAndLabels) {
  MemorySeries source = OneVolume({17, 14, 35}, volume::ScalarType::kUint8);
  PartitionOptions options = Cut("many");
  options.compression = store::BlockEncoding::kZstd;
  options.labels = {{.value = 3, .name = "three", .color = std::nullopt}};
  ExpectAlike(source, options, {3});
}

TEST_F(PartJoinerTest, BytesAreThoseOfOneProcessForSmallMemoryAndManyShards) {
  MemorySeries source = OneVolume({21, 30, 40}, volume::ScalarType::kUint16);
  PartitionOptions options = Cut("many");
  options.shard_count = 50;
  options.levels.highest = 1;
  options.memory_limit_bytes = 24 * base::kMiB;
  ExpectAlike(source, options, {4});
}

TEST_F(PartJoinerTest, BytesAreThoseOfOneProcessForSeriesWithComponentsAndSteps) {
  MemorySeries source(FlowFields(), {0, 0.5});
  PartitionOptions options = Cut("many");
  options.levels.highest = 1;
  ExpectAlike(source, options, {1, 2});
}

TEST_F(PartJoinerTest, OtherSourcesAndFlagsAreRefusedByName) {
  MemorySeries source = OneVolume({17, 14, 35}, volume::ScalarType::kUint8);
  PartitionOptions options = Cut("many");
  ISOSCOPE_ASSERT_OK(CutPart(source, options, 0, 2));
  EXPECT_THAT(CutPart(source, options, 1, 2, "b"),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       HasSubstr("the source is a there and b here")));
  options.seed = 6;
  EXPECT_THAT(CutPart(source, options, 1, 2), StatusIs(absl::StatusCode::kFailedPrecondition,
                                                       HasSubstr("--seed is 5 there and 6 here")));
}

TEST_F(PartJoinerTest, MissingPartsAreNamedAndNothingIsWritten) {
  MemorySeries source = OneVolume({17, 14, 35}, volume::ScalarType::kUint8);
  const PartitionOptions options = Cut("many");
  ISOSCOPE_ASSERT_OK(CutPart(source, options, 1, 4));
  EXPECT_THAT(JoinParts(options.output_directory, {}, never_),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       HasSubstr("parts 0, 2 and 3 of 4 are not finished")));
  EXPECT_THAT(EntriesOf(dir_.Sub("many")), ::testing::ElementsAre("d.partial"));
}

TEST_F(PartJoinerTest, ASourceThatChangesWhileItIsReadMakesNoPart) {
  MemorySeries source = OneVolume({17, 14, 35}, volume::ScalarType::kUint8);
  const PartitionOptions options = Cut("many");
  int asked = 0;
  source.identity_error = [&asked](int) {
    return ++asked > 1 ? absl::AbortedError("the file has changed") : absl::OkStatus();
  };
  EXPECT_THAT(CutPart(source, options, 0, 1), StatusIs(absl::StatusCode::kAborted));
  EXPECT_THAT(EntriesOf(PartFolder(options.output_directory).VolumePath(kOnlyVolumeFolder)),
              ::testing::IsEmpty());
}

TEST_F(PartJoinerTest, VolumesOfASeriesThatAPartHasFinishedAreKept) {
  MemorySeries source(FlowFields(), {0, 0.5});
  PartitionOptions options = Cut("many");
  options.levels.highest = 0;
  int opened = 0;
  source.identity_error = [&opened](int step) {
    return step == 1 && ++opened == 1 ? absl::AbortedError("gone") : absl::OkStatus();
  };
  EXPECT_THAT(CutPart(source, options, 0, 1), StatusIs(absl::StatusCode::kAborted));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const PartReport report,
                                PartitionPart(source,
                                              {.volume = options,
                                               .part = {.index = 0, .count = 1},
                                               .source_members = {{"the source", "a"}}},
                                              never_));
  EXPECT_EQ(report.kept_volumes, 5);  // p, three components of u and its magnitude at step 0
  EXPECT_EQ(report.written_volumes, 5);
}

}  // namespace
}  // namespace isoscope::partition
