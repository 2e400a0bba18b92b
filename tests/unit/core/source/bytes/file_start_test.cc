#include "core/source/bytes/file_start.h"

#include <string>

#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

TEST(FileStartTest, DecodesGzipAndStopsAtTheEnd) {
  const testing::TempDir dir;
  const std::string path = dir.Sub("a");
  const std::string text(5000, 't');
  testing::WriteFile(path, text);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FileStart plain, ReadFileStart(path, 100));
  EXPECT_EQ(plain.bytes, text.substr(0, 100));
  EXPECT_FALSE(plain.is_gzip);
  testing::WriteFile(path, testing::Gzip(text));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FileStart decoded, ReadFileStart(path, 4000));
  EXPECT_EQ(decoded.bytes, text.substr(0, 4000));
  EXPECT_TRUE(decoded.is_gzip);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FileStart whole, ReadFileStart(path, 9000));
  EXPECT_EQ(whole.bytes, text);
  testing::WriteFile(path, "");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FileStart empty, ReadFileStart(path, 9000));
  EXPECT_EQ(empty.bytes, "");
  testing::WriteFile(path, testing::Gzip(text).substr(0, 10) + std::string(50, '\xff'));
  EXPECT_THAT(ReadFileStart(path, 4000).status(), testing::StatusIs(absl::StatusCode::kDataLoss));
  EXPECT_THAT(ReadFileStart(dir.Sub("none"), 1).status(),
              testing::StatusIs(absl::StatusCode::kNotFound));
}

TEST(FileStartTest, GzipIsKnownByThreeBytes) {
  const testing::TempDir dir;
  const auto is_gzip = [&](const std::string& bytes) {
    testing::WriteFile(dir.Sub("a"), bytes);
    return IsGzipFile(dir.Sub("a"));
  };
  EXPECT_TRUE(is_gzip(testing::Gzip("text")));
  EXPECT_TRUE(is_gzip("\x1f\x8b\x08"));
  EXPECT_FALSE(is_gzip("\x1f\x8b"));
  EXPECT_FALSE(is_gzip("\x1f\x8b\x09 more"));
  EXPECT_FALSE(IsGzipFile(dir.Sub("none")));
}

}  // namespace
}  // namespace isoscope::source
