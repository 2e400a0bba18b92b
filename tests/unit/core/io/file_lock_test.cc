#include "core/io/file_lock.h"

#include <memory>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::io {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

TEST(FileLockTest, IsHeldByOneUntilItEnds) {
  testing::TempDir dir;
  const std::string path = dir.Sub("lock");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto first, FileLock::Take(path));
  EXPECT_TRUE(PathExists(path));
  EXPECT_THAT(FileLock::Take(path),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr(path)));
  first.reset();
  EXPECT_TRUE(PathExists(path));
  ISOSCOPE_EXPECT_OK(FileLock::Take(path).status());
}

TEST(FileLockTest, IsOnTheFileThatHasTheName) {
  testing::TempDir dir;
  const std::string path = dir.Sub("lock");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto first, FileLock::Take(path));
  ISOSCOPE_ASSERT_OK(RemoveRecursively(path));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto second, FileLock::Take(path));
  EXPECT_THAT(FileLock::Take(path), StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("")));
}

TEST(FileLockTest, NeedsAFolder) {
  testing::TempDir dir;
  EXPECT_THAT(FileLock::Take(dir.Sub("no/lock")),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("no/lock")));
}

}  // namespace
}  // namespace isoscope::io
