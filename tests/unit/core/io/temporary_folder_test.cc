#include "core/io/temporary_folder.h"

#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <sys/syscall.h>

#include "core/io/file.h"
#include "tests/support/status_matchers.h"

namespace {

std::atomic<int> fsync_calls{0};

}  // namespace

// In place of the C library's: it counts its calls.
extern "C" int fsync(int descriptor) {
  ++fsync_calls;
  return static_cast<int>(syscall(SYS_fsync, descriptor));
}

namespace isoscope::io {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

namespace fs = std::filesystem;

TEST(TemporaryFolderTest, IsOfItsOwnerAloneAndGoesWithAllThatIsInIt) {
  std::string path;
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(TemporaryFolder made, TemporaryFolder::Make());
    path = made.path();
    const TemporaryFolder folder = std::move(made);
    EXPECT_EQ(folder.path(), path);
    EXPECT_EQ(fs::status(path).permissions(), fs::perms::owner_all);
    EXPECT_EQ(folder.Sub("a"), path + "/a");
    std::ofstream(folder.Sub("a")) << "x";
    EXPECT_TRUE(fs::exists(folder.Sub("a")));
  }
  EXPECT_FALSE(fs::exists(path));
}

TEST(TemporaryFolderTest, FilesAreWrittenWithoutAWaitForTheDisk) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const TemporaryFolder folder, TemporaryFolder::Make());
  const int before = fsync_calls;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<WritableFile> file, folder.CreateFile("a"));
  ISOSCOPE_EXPECT_OK(file->Append("one "));
  ISOSCOPE_EXPECT_OK(file->Append("three"));
  ISOSCOPE_EXPECT_OK(file->WriteAt(4, "two"));
  EXPECT_EQ(file->size_bytes(), 9);
  ISOSCOPE_EXPECT_OK(file->Close());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadWholeFile(folder.Sub("a"), 100));
  EXPECT_EQ(bytes, "one twoee");
  EXPECT_EQ(fsync_calls, before);
  // The count works.
  ISOSCOPE_EXPECT_OK(WriteWholeFile(folder.Sub("b"), "x"));
  EXPECT_GT(fsync_calls, before);
  // As of any file.
  EXPECT_THAT(file->Append("x"), StatusIs(absl::StatusCode::kFailedPrecondition));
  ISOSCOPE_EXPECT_OK(file->Close());
  EXPECT_THAT(folder.CreateFile("a").status(),
              StatusIs(absl::StatusCode::kAlreadyExists, HasSubstr(folder.Sub("a"))));
}

}  // namespace
}  // namespace isoscope::io
