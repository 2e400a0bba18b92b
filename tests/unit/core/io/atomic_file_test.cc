#include "core/io/atomic_file.h"

#include <cstddef>
#include <filesystem>
#include <fstream>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <sys/stat.h>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::io {
namespace {

using ::isoscope::testing::IsOk;
using ::isoscope::testing::TempDir;
using ::testing::Not;

std::size_t EntryCount(const std::string& directory) {
  std::size_t count = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(directory)) {
    ++count;
  }
  return count;
}

TEST(AtomicFileTest, AtomicWriteReplacesAndLeavesNothingElse) {
  const TempDir folder;
  const std::string path = folder.Sub("a.png");
  ISOSCOPE_ASSERT_OK(WriteFileAtomically(path, "old"));
  ISOSCOPE_ASSERT_OK(WriteFileAtomically(path, "new"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string content, ReadWholeFile(path, 100));
  EXPECT_EQ(content, "new");
  EXPECT_EQ(EntryCount(folder.path()), 1U);
}

TEST(AtomicFileTest, FailedAtomicWriteKeepsTheOldState) {
  const TempDir folder;
  std::filesystem::create_directory(folder.Sub("taken"));
  EXPECT_THAT(WriteFileAtomically(folder.Sub("taken"), "x"), Not(IsOk()));
  EXPECT_THAT(WriteFileAtomically(folder.Sub("absent/a.png"), "x"), Not(IsOk()));
  EXPECT_EQ(EntryCount(folder.path()), 1U);
}

TEST(AtomicFileTest, AnAtomicFileAppearsWhenItIsCommittedAndElseLeavesNothing) {
  const TempDir folder;
  const std::string path = folder.Sub("a.png");
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto given_up, AtomicFile::Create(path));
    ISOSCOPE_ASSERT_OK(given_up->Append("half"));
  }
  EXPECT_EQ(EntryCount(folder.path()), 0U);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, AtomicFile::Create(path));
  ISOSCOPE_ASSERT_OK(file->Append("first, "));
  EXPECT_FALSE(std::filesystem::exists(path));
  ISOSCOPE_ASSERT_OK(file->Append("second"));
  ISOSCOPE_ASSERT_OK(file->Commit());
  EXPECT_EQ(file->size_bytes(), 13);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string content, ReadWholeFile(path, 100));
  EXPECT_EQ(content, "first, second");
  EXPECT_EQ(EntryCount(folder.path()), 1U);
}

TEST(AtomicFileTest, AHeaderIsFilledInLast) {
  const TempDir folder;
  const std::string path = folder.Sub("a.ply");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, AtomicFile::Create(path));
  ISOSCOPE_ASSERT_OK(file->Append("...., first"));
  ISOSCOPE_ASSERT_OK(file->WriteAt(0, "head"));
  EXPECT_EQ(file->size_bytes(), 11);
  ISOSCOPE_ASSERT_OK(file->Append(", second"));
  ISOSCOPE_ASSERT_OK(file->Commit());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string content, ReadWholeFile(path, 100));
  EXPECT_EQ(content, "head, first, second");
}

TEST(AtomicFileTest, DevicesAreWrittenAsTheyAre) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto device, AtomicFile::Create("/dev/null"));
  ISOSCOPE_EXPECT_OK(device->Append("x"));
  ISOSCOPE_EXPECT_OK(device->WriteAt(0, "y"));
  ISOSCOPE_EXPECT_OK(device->Commit());
  ISOSCOPE_EXPECT_OK(CheckWritable("/dev/null"));
  ISOSCOPE_EXPECT_OK(WriteFileAtomically("/dev/null", "x"));
  struct stat info {};
  ASSERT_EQ(stat("/dev/null", &info), 0);
  EXPECT_TRUE(S_ISCHR(info.st_mode));
}

TEST(AtomicFileTest, CheckWritableTellsWithoutATrace) {
  const TempDir folder;
  ISOSCOPE_EXPECT_OK(CheckWritable(folder.Sub("a.png")));
  EXPECT_EQ(EntryCount(folder.path()), 0U);
  std::ofstream(folder.Sub("b.png")) << "old";
  ISOSCOPE_EXPECT_OK(CheckWritable(folder.Sub("b.png")));
  EXPECT_EQ(EntryCount(folder.path()), 1U);
  EXPECT_THAT(CheckWritable(folder.Sub("absent/a.png")), Not(IsOk()));
  EXPECT_THAT(CheckWritable(folder.path()), Not(IsOk()));
}

}  // namespace
}  // namespace isoscope::io
