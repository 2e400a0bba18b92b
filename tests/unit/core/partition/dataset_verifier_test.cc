#include "core/partition/dataset_verifier.h"

#include <cstddef>
#include <filesystem>
#include <string>
#include <tuple>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/partition/series_partitioner.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/partition/partitioner_fixture.h"
#include "tests/unit/core/partition/series_fixture.h"

namespace isoscope::partition {
namespace {

namespace fs = std::filesystem;

using ::isoscope::testing::StatusIs;
using ::testing::_;
using ::testing::Contains;
using ::testing::HasSubstr;

class DatasetVerifierTest : public ::testing::Test {
 protected:
  // A dataset of version 1 or a series of two fields, of two shards.
  void Make(const std::string& name, bool is_series,
            store::BlockEncoding compression = store::BlockEncoding::kRaw) {
    MemorySeries source(
        {FlowFields()[0], {.name = "T", .long_name = "", .unit = "", .components = {""}}}, {0});
    SeriesPartitionOptions options;
    options.volume.output_directory = dir_.Sub(name);
    options.volume.block_cells = math::Index3{4, 4, 4};
    options.volume.shard_count = 2;
    options.volume.compression = compression;
    options.volume.levels.highest = levels_;
    if (is_series) {
      ISOSCOPE_ASSERT_OK(PartitionSeries(source, options, never_).status());
    } else {
      ISOSCOPE_ASSERT_OK(Partition(*source.Open(0, 0, 0).value(), options.volume, never_).status());
    }
  }
  absl::StatusOr<VerifyReport> Verify(const std::string& path) {
    damages_.clear();
    last_bytes_ = 0;
    return VerifyDataset(path,
                         {.damage = [&](const std::string& text) { damages_.push_back(text); },
                          .progress =
                              [&](std::int64_t done, std::int64_t total) {
                                EXPECT_GE(done, last_bytes_);
                                EXPECT_LE(done, total);
                                last_bytes_ = done;
                              }},
                         never_);
  }

  testing::TempDir dir_;
  base::Cancellation never_;
  int levels_ = 0;
  std::vector<std::string> damages_;
  std::int64_t last_bytes_ = 0;
};

TEST_F(DatasetVerifierTest, WhatIsWholeHasNoDamage) {
  Make("one", false);
  Make("flow", true, store::BlockEncoding::kZstd);
  for (const auto& [path, volumes, shards] : {std::tuple<const char*, int, int>{"one", 1, 2},
                                              {"one/shard-00001-of-00002", 1, 1},
                                              {"flow", 2, 2},
                                              {"flow/shard-00000-of-00002", 2, 1}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const VerifyReport report, Verify(dir_.Sub(path)));
    EXPECT_THAT(damages_, ::testing::IsEmpty()) << path;
    EXPECT_EQ(report.damage_count, 0);
    EXPECT_EQ(report.volume_count, volumes) << path;
    EXPECT_EQ(report.shard_count, shards) << path;
    EXPECT_EQ(report.missing_shard_count, 0);
    EXPECT_GT(report.file_bytes, 0);
    if (shards == 2) {
      EXPECT_EQ(report.block_count, 3 * 3 * 2 * volumes) << path;  // 12 x 10 x 8 cells
    }
  }
  fs::remove_all(dir_.Sub("flow/shard-00000-of-00002"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const VerifyReport report, Verify(dir_.Sub("flow")));
  EXPECT_EQ(report.damage_count, 0);
  EXPECT_EQ(report.missing_shard_count, 1);
}

// A bit in every file: at its begin, in the middle and at its end.
TEST_F(DatasetVerifierTest, AnyFlippedBitIsTold) {
  Make("one", false, store::BlockEncoding::kLz4);
  Make("flow", true);
  int file_count = 0;
  for (const char* name : {"one", "flow"}) {
    for (const auto& [file, bytes] : FilesBelow(dir_.Sub(name))) {
      ++file_count;
      const std::string path = absl::StrCat(dir_.Sub(name), "/", file);
      for (const std::size_t at : {std::size_t{0}, bytes.size() / 2, bytes.size() - 1}) {
        std::string damaged = bytes;
        damaged[at] = static_cast<char>(static_cast<unsigned char>(damaged[at]) ^ 0x10u);
        testing::WriteFile(path, damaged);
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const VerifyReport report, Verify(dir_.Sub(name)));
        EXPECT_GE(report.damage_count, 1) << path << " " << at;
        EXPECT_EQ(report.damage_count, static_cast<std::int64_t>(damages_.size()));
        EXPECT_THAT(damages_, Contains(HasSubstr(path))) << at;
      }
      testing::WriteFile(path, bytes);
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const VerifyReport report, Verify(dir_.Sub(name)));
    EXPECT_EQ(report.damage_count, 0);
  }
  EXPECT_EQ(file_count, 2 + 2 * 7 + 1 + 2 * (2 + 2 * 7));
}

TEST_F(DatasetVerifierTest, AnyFlippedBitAndMissingFileOfALevelIsTold) {
  levels_ = 1;
  Make("one", false, store::BlockEncoding::kZstd);
  Make("flow", true);
  int file_count = 0;
  for (const char* name : {"one", "flow"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const VerifyReport whole, Verify(dir_.Sub(name)));
    EXPECT_EQ(whole.damage_count, 0);
    for (const auto& [file, bytes] : FilesBelow(dir_.Sub(name))) {
      if (file.find("level_1/") == std::string::npos) {
        continue;
      }
      ++file_count;
      const std::string path = absl::StrCat(dir_.Sub(name), "/", file);
      std::string damaged = bytes;
      damaged[bytes.size() / 2] =
          static_cast<char>(static_cast<unsigned char>(damaged[bytes.size() / 2]) ^ 0x10u);
      testing::WriteFile(path, damaged);
      ISOSCOPE_ASSERT_OK(Verify(dir_.Sub(name)).status());
      EXPECT_THAT(damages_, Contains(HasSubstr(path)));
      fs::remove(path);
      ISOSCOPE_ASSERT_OK(Verify(dir_.Sub(name)).status());
      EXPECT_THAT(damages_, Contains(HasSubstr("level_1"))) << path;
      testing::WriteFile(path, bytes);
    }
  }
  EXPECT_EQ(file_count, 2 * 7 + 2 * 2 * 7);
}

TEST_F(DatasetVerifierTest, AnyMissingOrShortFileIsTold) {
  Make("flow", true);
  for (const auto& [file, bytes] : FilesBelow(dir_.Sub("flow"))) {
    if (file == "manifest.json") {
      continue;  // without it there is no dataset
    }
    const std::string path = absl::StrCat(dir_.Sub("flow"), "/", file);
    for (const bool is_short : {true, false}) {
      fs::remove(path);
      if (is_short) {
        testing::WriteFile(path, bytes.substr(0, bytes.size() / 2));
      }
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const VerifyReport report, Verify(dir_.Sub("flow")));
      EXPECT_GE(report.damage_count, 1) << path;
      testing::WriteFile(path, bytes);
    }
  }
  fs::remove_all(dir_.Sub("flow/shard-00000-of-00002/field-001-component-0-step-00000"));
  ISOSCOPE_ASSERT_OK(Verify(dir_.Sub("flow")).status());
  EXPECT_THAT(damages_, ::testing::ElementsAre(HasSubstr("is missing")));
}

TEST_F(DatasetVerifierTest, EveryDamagedBlockIsTold) {
  Make("one", false);
  const std::string path = dir_.Sub("one/shard-00000-of-00002/blocks.bin");
  std::string bytes = testing::ReadFile(path);
  for (char& byte : bytes) {
    byte = static_cast<char>(byte + 1);
  }
  testing::WriteFile(path, bytes);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto reader,
                                store::ShardReader::Open(dir_.Sub("one/shard-00000-of-00002")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const VerifyReport report, Verify(dir_.Sub("one")));
  EXPECT_EQ(report.damage_count, reader->block_count());
  EXPECT_THAT(damages_, ::testing::Each(HasSubstr("block ")));
}

TEST_F(DatasetVerifierTest, MixedFilesAreTold) {
  Make("flow", true);
  const std::string shards[2] = {dir_.Sub("flow/shard-00000-of-00002/"),
                                 dir_.Sub("flow/shard-00001-of-00002/")};
  const std::string first = "field-000-component-0-step-00000";
  const std::string second = "field-001-component-0-step-00000";
  // Whole folders of another volume, and of another shard.
  fs::rename(shards[0] + first, dir_.Sub("kept"));
  for (const std::string& other : {shards[0] + second, shards[1] + first}) {
    fs::copy(other, shards[0] + first, fs::copy_options::recursive);
    ISOSCOPE_ASSERT_OK(Verify(dir_.Sub("flow")).status());
    EXPECT_THAT(damages_, Contains(HasSubstr("does not belong to this series")));
    fs::remove_all(shards[0] + first);
  }
  fs::rename(dir_.Sub("kept"), shards[0] + first);
  ISOSCOPE_ASSERT_OK(Verify(dir_.Sub("flow")).status());
  EXPECT_THAT(damages_, ::testing::IsEmpty());
}

TEST_F(DatasetVerifierTest, WhatIsNoDatasetIsAnError) {
  EXPECT_THAT(Verify(dir_.Sub("nothing")), StatusIs(absl::StatusCode::kNotFound, _));
  EXPECT_THAT(Verify(dir_.path()), StatusIs(absl::StatusCode::kNotFound, _));
  Make("flow", true);
  base::Cancellation cancelled;
  cancelled.Cancel();
  EXPECT_THAT(VerifyDataset(dir_.Sub("flow"), {}, cancelled),
              StatusIs(absl::StatusCode::kCancelled, _));
}

}  // namespace
}  // namespace isoscope::partition
