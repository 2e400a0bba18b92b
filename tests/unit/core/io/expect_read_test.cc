#include "core/io/expect_read.h"

#include <memory>
#include <string>

#include "gtest/gtest.h"

#include "core/io/atomic_file.h"
#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::io {
namespace {

using isoscope::testing::StatusIs;

class ExpectReadTest : public ::testing::Test {
 protected:
  static constexpr std::size_t kSize = 700'001;  // several pieces, and a bit

  void SetUp() override {
    bytes_.resize(kSize, 'x');
    bytes_.back() = 'y';
    ISOSCOPE_ASSERT_OK(WriteFileAtomically(temp_.Sub("file"), bytes_));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(file_, OpenRandomAccessFile(temp_.Sub("file")));
  }

  const testing::TempDir temp_;
  std::string bytes_;
  std::unique_ptr<RandomAccessFile> file_;
};

TEST_F(ExpectReadTest, TheBytesCanBeReadWithoutTheDisk) {
  const FileRead read{.file = file_.get(), .offset = 0, .size = kSize};
  ExpectRead(read);
  ISOSCOPE_ASSERT_OK(AwaitExpectedRead(read));
  std::string found(kSize, ' ');
  ISOSCOPE_ASSERT_OK(file_->ReadAt(0, kSize, found.data()));
  EXPECT_EQ(found, bytes_);
}

TEST_F(ExpectReadTest, BytesThatTheFileLacksAreAnErrorOfTheWait) {
  const FileRead read{.file = file_.get(), .offset = 1, .size = kSize};
  ExpectRead(read);
  EXPECT_THAT(AwaitExpectedRead(read), StatusIs(absl::StatusCode::kDataLoss));
}

}  // namespace
}  // namespace isoscope::io
