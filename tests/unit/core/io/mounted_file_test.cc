#include "core/io/mounted_file.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/io/file.h"
#include "tests/support/memory_file.h"
#include "tests/support/status_matchers.h"

namespace isoscope::io {
namespace {

using testing::IsOk;
using testing::StatusIs;

class NamedFile : public RandomAccessFile {
 public:
  NamedFile(std::string path, const std::string& bytes) : path_(std::move(path)), bytes_(bytes) {}
  [[nodiscard]] absl::Status ReadAt(std::int64_t offset, std::size_t size,
                                    char* out) const override {
    return bytes_.ReadAt(offset, size, out);
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return bytes_.size_bytes(); }
  [[nodiscard]] const std::string& path() const override { return path_; }

 private:
  const std::string path_;
  const testing::MemoryReadFile bytes_;
};

std::shared_ptr<const RandomAccessFile> FileOf(const std::string& path, const std::string& bytes) {
  return std::make_shared<NamedFile>(path, bytes);
}

TEST(MountedFileTest, IsOpenedByItsNameAlone) {
  const std::string path = "https://host/mounted/a.raw";
  EXPECT_FALSE(IsMounted(path));
  EXPECT_FALSE(PathExists(path));
  EXPECT_THAT(OpenRandomAccessFile(path).status(), StatusIs(absl::StatusCode::kNotFound));
  MountFile({.file = FileOf(path, "abc"), .version = "v1", .tells_all = false});
  EXPECT_TRUE(IsMounted(path));
  EXPECT_TRUE(PathExists(path));
  EXPECT_FALSE(IsDirectory(path));
  EXPECT_THAT(CheckIsRegularFile(path), IsOk());
  EXPECT_EQ(*ReadWholeFile(path, 3), "abc");
  EXPECT_EQ(FindMounted(path)->version, "v1");
  EXPECT_FALSE(FindMounted(path)->tells_all);
  EXPECT_FALSE(PathExists(path + "b"));
  EXPECT_FALSE(PathExists("https://host/mounted/b.raw"));
}

TEST(MountedFileTest, AnotherFileTakesItsPlaceForThoseWhoOpenItLater) {
  const std::string path = "s3://bucket/mounted/b.raw";
  MountFile({.file = FileOf(path, "old")});
  const auto before = OpenRandomAccessFile(path);
  ASSERT_THAT(before.status(), IsOk());
  MountFile({.file = FileOf(path, "newer")});
  EXPECT_EQ(*ReadWholeFile(**before, 10), "old");
  EXPECT_EQ(*ReadWholeFile(path, 10), "newer");
}

TEST(MountedFileTest, TellsAddressesFromPaths) {
  for (const char* const address : {"https://h/a", "s3://b/k", "HTTP://h", "svn+ssh://h"}) {
    EXPECT_TRUE(IsAddressText(address)) << address;
  }
  for (const char* const path : {"", "a", "/a/b", "://a", "a://", "1a://b", "/https://a",
                                 "dir/http://a", "a b://c", "h:/a"}) {
    EXPECT_FALSE(IsAddressText(path)) << path;
  }
}

}  // namespace
}  // namespace isoscope::io
