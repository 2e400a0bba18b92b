#include "client-cli/session/cache_entry.h"

#include <chrono>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "client-cli/commands/program.h"
#include "core/base/cancellation.h"
#include "core/cli/interrupt.h"
#include "core/partition/series_partitioner.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/core/partition/series_fixture.h"

namespace isoscope::cli {
namespace {

namespace fs = std::filesystem;

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;

constexpr char kName[] = "v-0123456789abcdef";

void MakeDataset(const std::string& directory) {
  const TempDir folder;
  Interrupt interrupt;
  std::ostringstream ignored;
  const Context context{.out = &ignored, .err = &ignored, .interrupt = &interrupt};
  ASSERT_EQ(RunProgram(IsoscopeProgram(),
                       {"generate", "gyroid", "--dims", "9,9,9", "--type", "uint8", "--output",
                        folder.Sub("v.nrrd")},
                       context),
            0);
  ASSERT_EQ(RunProgram(IsoscopeProgram(),
                       {"partition", folder.Sub("v.nrrd"), "--output", directory}, context),
            0);
}

TEST(EntryNameTest, IsAStemAndADigest) {
  for (const char* name : {kName, "-0123456789abcdef", "a-b-00000000ffffffff"}) {
    EXPECT_TRUE(IsEntryName(name)) << name;
  }
  for (const char* name : {"", "v", "v-0123456789abcde", "v-0123456789ABCDEF", "v-0123456789abcdeg",
                           "v_0123456789abcdef", "0123456789abcdef", ".v-0123456789abcdef"}) {
    EXPECT_FALSE(IsEntryName(name)) << name;
  }
}

TEST(UseEntryTest, NotesSourceAndTime) {
  const TempDir cache;
  fs::create_directory(cache.Sub(kName));
  EXPECT_THAT(UseEntry(cache.Sub("absent"), "/v"), StatusIs(absl::StatusCode::kNotFound));
  const absl::Time start = absl::Now();
  for (const char* source : {"/data/first", "/data/second"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const EntryLock lock, UseEntry(cache.Sub(kName), source));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<CacheEntry> entries, ListEntries(cache.path()));
    ASSERT_EQ(entries.size(), 1);
    EXPECT_EQ(entries[0].source, "/data/first") << "the source stays that of the first use";
    EXPECT_TRUE(entries[0].is_in_use);
    EXPECT_GE(entries[0].last_used, start - absl::Seconds(1));
    fs::last_write_time(cache.Sub(kName) + "/.cache-entry",
                        fs::file_time_type::clock::now() - std::chrono::hours(1));
  }
  EXPECT_FALSE(ListEntries(cache.path())->front().is_in_use);
}

TEST(ListEntriesTest, DescribesWholeAndDamagedOnes) {
  const TempDir cache;
  MakeDataset(cache.Sub(kName));
  fs::create_directory(cache.Sub("w-0123456789abcdef"));
  std::ofstream(cache.Sub("w-0123456789abcdef/manifest.json")) << "rubble";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<CacheEntry> entries, ListEntries(cache.path()));
  ASSERT_EQ(entries.size(), 2);
  const CacheEntry& whole = entries[entries[0].name == kName ? 0 : 1];
  const CacheEntry& damaged = entries[entries[0].name == kName ? 1 : 0];
  EXPECT_FALSE(whole.is_damaged);
  EXPECT_EQ(whole.source, "v.nrrd") << "of the manifest, as nobody has used it yet";
  EXPECT_GT(whole.size_bytes, 9 * 9 * 9);
  EXPECT_TRUE(damaged.is_damaged);
  EXPECT_EQ(damaged.size_bytes, 6);
  EXPECT_EQ(TotalBytes(entries), whole.size_bytes + 6);
}

// Symptom: every series was listed as damaged.
TEST(ListEntriesTest, ASeriesIsDamagedIfItLacksAVolumeAlone) {
  const TempDir cache;
  partition::MemorySeries source(partition::FlowFields(), {0, 1});
  partition::SeriesPartitionOptions options;
  options.volume.output_directory = cache.Sub(kName);
  options.volume.source_name = "flow.pvd";
  ISOSCOPE_ASSERT_OK(partition::PartitionSeries(source, options, base::Cancellation()).status());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(std::vector<CacheEntry> entries, ListEntries(cache.path()));
  ASSERT_EQ(entries.size(), 1);
  EXPECT_FALSE(entries[0].is_damaged);
  EXPECT_EQ(entries[0].source, "flow.pvd");
  fs::remove_all(cache.Sub(kName) + "/shard-00000-of-00001/field-001-component-2-step-00001");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(entries, ListEntries(cache.path()));
  EXPECT_TRUE(entries[0].is_damaged);
}

TEST(ListEntriesTest, AnEntryThatWasMarkedIsDamaged) {
  const TempDir cache;
  MakeDataset(cache.Sub(kName));
  EXPECT_FALSE(IsMarkedDamaged(cache.Sub(kName)));
  MarkDamaged(cache.Sub(kName));
  EXPECT_TRUE(IsMarkedDamaged(cache.Sub(kName)));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<CacheEntry> entries, ListEntries(cache.path()));
  EXPECT_TRUE(entries[0].is_damaged);
}

TEST(NoteTest, IsKeptWithTheEntry) {
  const TempDir cache;
  MakeDataset(cache.Sub(kName));
  EXPECT_EQ(ReadNote(cache.Sub(kName)), "");
  ISOSCOPE_ASSERT_OK(WriteNote(cache.Sub(kName), "takes field \"p\""));
  EXPECT_EQ(ReadNote(cache.Sub(kName)), "takes field \"p\"");
}

TEST(ListEntriesTest, AFolderThatCantBeReadIsAnError) {
  const TempDir cache;
  EXPECT_THAT(ListEntries(cache.Sub("absent")), StatusIs(absl::StatusCode::kNotFound));
}

TEST(RemoveEntryTest, TakesDamagedOnesAndThoseThatWereNeverUsed) {
  const TempDir cache;
  fs::create_directories(cache.Sub(kName) + "/shard-00000-of-00001");
  std::ofstream(cache.Sub(kName) + "/shard-00000-of-00001/blocks.bin") << "rubble";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const bool is_gone, RemoveEntry(cache.path(), kName));
  EXPECT_TRUE(is_gone);
  EXPECT_TRUE(fs::is_empty(cache.path()));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const bool is_still_gone, RemoveEntry(cache.path(), kName));
  EXPECT_TRUE(is_still_gone);
}

}  // namespace
}  // namespace isoscope::cli
