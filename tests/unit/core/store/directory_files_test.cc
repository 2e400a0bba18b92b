// Descriptions that are damaged or mixed: shard_reader_test.

#include "core/store/directory_files.h"

#include <cstdint>
#include <fstream>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::store {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

TEST(DirectoryFilesTest, AFileThatIsMissingOrOfAnotherSizeIsDataLoss) {
  const testing::TempDir directory;
  const std::string path = PathIn(directory.path(), "file");
  EXPECT_EQ(path, directory.path() + "/file");
  const OpenFile open_file = io::OpenRandomAccessFile;
  const auto is_missing = StatusIs(absl::StatusCode::kDataLoss, HasSubstr(path + ": is missing"));
  EXPECT_THAT(OpenRequired(path, open_file), is_missing);
  EXPECT_THAT(ReadRequired(path, 4, open_file), is_missing);
  EXPECT_THAT(ReadRequiredJson(path, 4, open_file), is_missing);

  std::ofstream(path) << "four";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(std::string bytes, ReadRequired(path, 4, open_file));
  EXPECT_EQ(bytes, "four");
  EXPECT_THAT(ReadRequired(path, 3, open_file),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("4 bytes, expected 3")));
  EXPECT_THAT(ReadRequired(path, 5, open_file), StatusIs(absl::StatusCode::kDataLoss));
  for (const std::int64_t limit : {4, 5}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(bytes, ReadRequiredJson(path, limit, open_file));
    EXPECT_EQ(bytes, "four");
  }
  EXPECT_THAT(ReadRequiredJson(path, 3, open_file),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("4 bytes, expected at most 3")));
}

TEST(DirectoryFilesTest, OtherErrorsOfTheDiskStayAsTheyAre) {
  const OpenFile refuses = [](const std::string&) { return absl::PermissionDeniedError("no"); };
  EXPECT_THAT(ReadRequired("file", 4, refuses), StatusIs(absl::StatusCode::kPermissionDenied));
  EXPECT_THAT(ReadDescriptions("folder", refuses), StatusIs(absl::StatusCode::kPermissionDenied));
}

}  // namespace
}  // namespace isoscope::store
