// Symptom: a file that was written again with its size and time kept, or a link that led to another
// file, gave the picture of the old one.

#include "core/source/source_stamps.h"

#include <fcntl.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <linux/magic.h>
#include <sys/mman.h>
#include <sys/vfs.h>

#include "tests/support/skips.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

namespace fs = std::filesystem;

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteFile;
using ::testing::HasSubstr;

std::string Stamp(const std::string& path) { return StampsOf({path}).value(); }

TEST(SourceStampsTest, AChangeRightAfterTheStampShowsThoughSizeAndTimeAreKept) {
  const TempDir dir;
  const std::string path = dir.Sub("v.raw");
  for (int i = 0; i < 20; ++i) {
    WriteFile(path, "one");
    const auto time = fs::last_write_time(path);
    const std::string before = Stamp(path);
    EXPECT_EQ(Stamp(path), before) << "nothing has changed";
    WriteFile(path, "two");  // within the tick of the file system's clock, but for the wait
    fs::last_write_time(path, time);
    EXPECT_NE(Stamp(path), before) << i;
  }
}

TEST(SourceStampsTest, TimesSizesAndNamesCount) {
  const TempDir dir;
  const std::string path = dir.Sub("v.raw");
  WriteFile(path, "one");
  const std::string before = Stamp(path);
  fs::last_write_time(path, fs::last_write_time(path) + std::chrono::nanoseconds(1));
  const std::string later = Stamp(path);
  EXPECT_NE(later, before);
  WriteFile(path, "ones");
  EXPECT_NE(Stamp(path), later);
  fs::copy(path, dir.Sub("w.raw"));
  EXPECT_NE(StampsOf({path, dir.Sub("w.raw")}).value(), StampsOf({dir.Sub("w.raw"), path}).value())
      << "the order of slices is part of it";
}

// Files that were unpacked together may have one size and all times alike.
TEST(SourceStampsTest, FoldersThatTakeEachOthersPlaceShow) {
  for (int i = 0; i < 20; ++i) {
    const TempDir dir;
    for (const char* name : {"a", "b"}) {
      fs::create_directory(dir.Sub(name));
      WriteFile(dir.Sub(name) + "/v.raw", name);
    }
    fs::last_write_time(dir.Sub("b/v.raw"), fs::last_write_time(dir.Sub("a/v.raw")));
    const std::string path = dir.Sub("run/v.raw");
    fs::rename(dir.Sub("a"), dir.Sub("run"));
    const std::string before = Stamp(path);
    fs::rename(dir.Sub("run"), dir.Sub("a"));
    fs::rename(dir.Sub("b"), dir.Sub("run"));
    EXPECT_NE(Stamp(path), before) << i;
  }
}

// Symptom: numpy.memmap wrote to a page again, and the file's times stayed.
TEST(SourceStampsTest, AnotherWriteThroughAMapShows) {
  const TempDir dir;
  const std::string path = dir.Sub("v.raw");
  WriteFile(path, std::string(4096, 'a'));
  struct statfs disk {};
  ASSERT_EQ(statfs(path.c_str(), &disk), 0);
  if (disk.f_type == TMPFS_MAGIC || disk.f_type == OVERLAYFS_SUPER_MAGIC) {
    ISOSCOPE_SKIP("mapped_times", "this file system may never tell of such a write");
  }
  const int file = open(path.c_str(), O_RDWR | O_CLOEXEC);
  ASSERT_GE(file, 0);
  void* const map = mmap(nullptr, 4096, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  ASSERT_NE(map, MAP_FAILED);
  auto* const bytes = static_cast<volatile char*>(map);
  bytes[0] = 'b';
  for (const char c : {'c', 'd', 'e'}) {
    const std::string before = Stamp(path);
    bytes[0] = c;
    EXPECT_NE(Stamp(path), before) << c;
  }
  munmap(map, 4096);
  close(file);
}

TEST(SourceStampsTest, ALinkIsWhatItLeadsTo) {
  const TempDir dir;
  fs::create_directory(dir.Sub("one"));
  fs::create_directory(dir.Sub("two"));
  WriteFile(dir.Sub("one/v.raw"), "one");
  WriteFile(dir.Sub("two/v.raw"), "two");
  fs::last_write_time(dir.Sub("two/v.raw"), fs::last_write_time(dir.Sub("one/v.raw")));
  fs::create_directory_symlink("one", dir.Sub("run"));
  fs::create_symlink("run/v.raw", dir.Sub("link.raw"));
  const std::string before = Stamp(dir.Sub("link.raw"));
  EXPECT_EQ(before, Stamp(dir.Sub("one/v.raw")));
  fs::remove(dir.Sub("run"));
  fs::create_directory_symlink("two", dir.Sub("run"));
  EXPECT_EQ(Stamp(dir.Sub("link.raw")), Stamp(dir.Sub("two/v.raw")));
  EXPECT_NE(Stamp(dir.Sub("link.raw")), before);
  fs::remove(dir.Sub("two/v.raw"));
  EXPECT_THAT(StampsOf({dir.Sub("link.raw")}),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("link.raw")));
}

TEST(SourceStampsTest, PathsOfPartsAreResolvedAsFarAsTheyExist) {
  const TempDir dir;
  fs::create_directory(dir.Sub("one"));
  WriteFile(dir.Sub("one/run.h5"), "x");
  fs::create_directory_symlink("one", dir.Sub("run"));
  EXPECT_EQ(ResolvedPath(dir.Sub("run/./run.h5")).value(), fs::canonical(dir.Sub("one/run.h5")));
  EXPECT_EQ(ResolvedPath(dir.Sub("run/run.h5:/a/b")).value(),
            fs::canonical(dir.path()).string() + "/one/run.h5:/a/b");
}

}  // namespace
}  // namespace isoscope::source
