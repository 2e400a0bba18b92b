#include "core/io/continued_file.h"

#include <memory>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::io {
namespace {

using ::testing::HasSubstr;
using testing::StatusIs;

TEST(ContinuedFileTest, WritesBehindTheBytesThatStay) {
  const testing::TempDir dir;
  const std::string path = dir.Write("f", std::string(300'000, 'a'));
  for (const std::int64_t kept : {300'000, 262'144, 100'001, 0}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<WritableFile> file,
                                  ContinueWritableFile(path, kept));
    EXPECT_EQ(file->size_bytes(), kept);
    ISOSCOPE_ASSERT_OK(file->Append("bc"));
    EXPECT_EQ(file->size_bytes(), kept + 2);
    ISOSCOPE_ASSERT_OK(file->Close());
    EXPECT_EQ(*ReadWholeFile(path, 1'000'000),
              std::string(static_cast<std::size_t>(kept), 'a') + "bc");
    ISOSCOPE_ASSERT_OK(RemoveRecursively(path));
    ISOSCOPE_ASSERT_OK(WriteWholeFile(path, std::string(300'000, 'a')));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<WritableFile> only_cut,
                                ContinueWritableFile(path, 5));
  ISOSCOPE_ASSERT_OK(only_cut->Close());
  EXPECT_EQ(*ReadWholeFile(path, 10), "aaaaa");
}

TEST(ContinuedFileTest, RefusesByName) {
  const testing::TempDir dir;
  const std::string path = dir.Write("f", "12345");
  EXPECT_THAT(ContinueWritableFile(path, 6),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("ends after 5 bytes")));
  EXPECT_THAT(ContinueWritableFile(dir.Sub("none"), 0), StatusIs(absl::StatusCode::kNotFound));
  EXPECT_FALSE(ContinueWritableFile(dir.path(), 0).ok());
}

}  // namespace
}  // namespace isoscope::io
