#include "core/io/file_array.h"

#include <cstdint>
#include <filesystem>
#include <numeric>
#include <vector>

#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::io {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;

TEST(FileArrayTest, ValuesStayWhileItGrowsAndNewOnesAreZero) {
  const TempDir folder;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto array, FileArray<std::uint32_t>::Create(folder.path()));
  EXPECT_EQ(array.size(), 0U);
  std::vector<std::uint32_t> part(300'000);
  std::iota(part.begin(), part.end(), 1);
  for (int i = 0; i < 12; ++i) {  // 14 MB: it moves more than once
    ISOSCOPE_ASSERT_OK(array.Append(part));
  }
  ISOSCOPE_ASSERT_OK(array.Resize(array.size() + 1000));
  ASSERT_EQ(array.size(), 12 * part.size() + 1000);
  for (std::size_t i = 0; i < array.size(); ++i) {
    ASSERT_EQ(array.values()[i], i < 12 * part.size() ? part[i % part.size()] : 0U) << i;
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder.path())) << "the file has a name";
}

TEST(FileArrayTest, FolderThatIsMissingIsAnError) {
  EXPECT_THAT(FileArray<int>::Create("/nonexistent/folder").status(),
              StatusIs(absl::StatusCode::kNotFound));
}

TEST(FileArrayTest, MoreThanTheDiskHasIsAnErrorNotASignal) {
  const TempDir folder;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto array, FileArray<std::uint64_t>::Create(folder.path()));
  EXPECT_FALSE(array.Resize(std::size_t{1} << 55).ok());
  ISOSCOPE_EXPECT_OK(array.Resize(10));
}

}  // namespace
}  // namespace isoscope::io
