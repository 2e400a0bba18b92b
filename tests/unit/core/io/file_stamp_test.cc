#include "core/io/file_stamp.h"

#include <filesystem>

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

}  // namespace
}  // namespace isoscope::io
