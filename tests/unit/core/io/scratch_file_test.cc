#include "core/io/scratch_file.h"

#include <filesystem>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::io {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::_;
using ::testing::HasSubstr;

TEST(ScratchFileTest, HoldsWhatWasWrittenAndHasNoName) {
  const TempDir dir;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, ScratchFile::Create(dir.path()));
  EXPECT_TRUE(std::filesystem::is_empty(dir.path()));
  // Sparse, beyond 4 GiB.
  const std::int64_t far = (std::int64_t{5} << 30) + 3;
  ISOSCOPE_ASSERT_OK(file->WriteAt(0, "abcdef", 6));
  ISOSCOPE_ASSERT_OK(file->WriteAt(2, "XY", 2));
  ISOSCOPE_ASSERT_OK(file->WriteAt(far, "far", 3));
  std::string bytes(6, '\0');
  ISOSCOPE_ASSERT_OK(file->ReadAt(0, 6, bytes.data()));
  EXPECT_EQ(bytes, "abXYef");
  ISOSCOPE_ASSERT_OK(file->ReadAt(far - 3, 6, bytes.data()));
  EXPECT_EQ(bytes, std::string("\0\0\0far", 6));
  EXPECT_THAT(file->ReadAt(far, 4, bytes.data()),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("1 bytes more")));
}

TEST(ScratchFileTest, FolderThatIsNotThereIsNotFound) {
  const TempDir dir;
  EXPECT_THAT(ScratchFile::Create(dir.Sub("absent")).status(),
              StatusIs(absl::StatusCode::kNotFound, _));
}

}  // namespace
}  // namespace isoscope::io
