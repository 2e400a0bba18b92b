#include "core/io/file_stamp.h"

#include <chrono>
#include <filesystem>
#include <fstream>

#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gtest/gtest.h"

#include "core/io/atomic_file.h"
#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::io {
namespace {

TEST(FileStampTest, AFileThatIsWrittenOrReplacedHasAnotherStamp) {
  const testing::TempDir dir;
  const std::string path = dir.Sub("f");
  EXPECT_EQ(StampOf(path), FileStamp());
  ISOSCOPE_ASSERT_OK(WriteWholeFile(path, "one"));
  const FileStamp first = StampOf(path);
  EXPECT_NE(first, FileStamp());
  EXPECT_EQ(first.size, 3);
  EXPECT_EQ(StampOf(path), first) << "nothing has changed";
  // The same bytes and times under another inode, as a careful writer leaves them.
  ISOSCOPE_ASSERT_OK(WriteFileAtomically(path, "two"));
  EXPECT_NE(StampOf(path), first);
  std::filesystem::remove(path);
  EXPECT_EQ(StampOf(path), FileStamp());
}

TEST(FileStampTest, ATimeThatIsSetBackDoesNotHideAChange) {
  const testing::TempDir dir;
  const std::string path = dir.Sub("f");
  ISOSCOPE_ASSERT_OK(WriteWholeFile(path, "one"));
  const auto time = std::filesystem::last_write_time(path) - std::chrono::hours(1);
  std::filesystem::last_write_time(path, time);
  const FileStamp first = StampOf(path);
  // The clock of the file system may stand still for some milliseconds.
  FileStamp second = first;
  for (int i = 0; i < 1000 && second == first; ++i) {
    std::ofstream(path) << "two";
    std::filesystem::last_write_time(path, time);
    second = StampOf(path);
    absl::SleepFor(absl::Milliseconds(1));
  }
  EXPECT_EQ(second.size, first.size);
  EXPECT_EQ(second.modified, first.modified);
  EXPECT_NE(second.changed, first.changed);
  EXPECT_NE(second, first);
}

TEST(FileStampTest, ALinkHasTheStampOfItsFile) {
  const testing::TempDir dir;
  ISOSCOPE_ASSERT_OK(WriteWholeFile(dir.Sub("f"), "one"));
  std::filesystem::create_symlink("f", dir.Sub("link"));
  EXPECT_EQ(StampOf(dir.Sub("link")), StampOf(dir.Sub("f")));
}

}  // namespace
}  // namespace isoscope::io
