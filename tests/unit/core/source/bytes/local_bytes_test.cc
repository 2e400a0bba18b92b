#include "core/source/bytes/local_bytes.h"

#include <filesystem>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/base/random.h"
#include "tests/support/folder_test.h"
#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::testing::HasSubstr;
using testing::StatusIs;

std::string RandomBytes(std::size_t size) {
  std::string bytes(size, '\0');
  for (std::size_t i = 0; i < size; ++i) {
    bytes[i] = static_cast<char>(base::RandomBits(5, i));
  }
  return bytes;
}

class LocalBytesTest : public testing::FolderTest {
 protected:
  base::Cancellation never_;
};

TEST_F(LocalBytesTest, ReadsRangesInAnyOrder) {
  const std::string bytes = RandomBytes(10000);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenFileBytes(Write("a", bytes)));
  EXPECT_EQ(source->size_bytes(), 10000);
  EXPECT_EQ(source->name(), dir_.Sub("a"));
  std::string out(300, '\0');
  const std::vector<ByteRange> ranges = {{.offset = 9900, .size = 100, .out = out.data()},
                                         {.offset = 0, .size = 100, .out = out.data() + 100},
                                         {.offset = 10000, .size = 0, .out = nullptr},
                                         {.offset = 50, .size = 100, .out = out.data() + 200}};
  ISOSCOPE_ASSERT_OK(source->ReadRanges(ranges, never_));
  EXPECT_EQ(out, bytes.substr(9900) + bytes.substr(0, 100) + bytes.substr(50, 100));
}

TEST_F(LocalBytesTest, ChecksRangesBeforeItReads) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenFileBytes(Write("a", "0123456789")));
  for (const ByteRange& bad :
       {ByteRange{.offset = 5, .size = 6}, ByteRange{.offset = -1, .size = 1},
        ByteRange{.offset = 11, .size = 0}, ByteRange{.offset = 0, .size = ~std::size_t{0}}}) {
    char byte = 'x';
    const std::vector<ByteRange> ranges = {{.offset = 0, .size = 1, .out = &byte}, bad};
    EXPECT_THAT(source->ReadRanges(ranges, never_),
                StatusIs(absl::StatusCode::kOutOfRange, HasSubstr("has 10 bytes")));
    EXPECT_EQ(byte, 'x');
  }
}

TEST_F(LocalBytesTest, SaysWhatEndsAnOpenFile) {
  const std::string path = Write("a", "0123456789");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenFileBytes(path));
  std::filesystem::resize_file(path, 4);
  std::string out(10, '\0');
  EXPECT_THAT(source->ReadAt(0, 10, out.data(), never_),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("ends after 4 bytes")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto again, OpenFileBytes(path));
  EXPECT_NE(again->version(), source->version());
  base::Cancellation cancelled;
  cancelled.Cancel();
  EXPECT_THAT(source->ReadAt(0, 1, out.data(), cancelled), StatusIs(absl::StatusCode::kCancelled));
  EXPECT_THAT(OpenFileBytes(dir_.Sub("none")), StatusIs(absl::StatusCode::kNotFound));
  EXPECT_THAT(OpenFileBytes(dir_.path()), StatusIs(absl::StatusCode::kFailedPrecondition));
}

TEST_F(LocalBytesTest, AFolderIsAStore) {
  Write("z/c/0/1", "0123456789");
  Write("z/a=b +c", "plain");
  Write("outside", "beyond");
  std::filesystem::create_symlink(dir_.Sub("outside"), dir_.Sub("z/link"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto store, OpenFolderStore(dir_.Sub("z")));
  EXPECT_EQ(store->name(), dir_.Sub("z"));
  const std::vector<ObjectRead> reads = {
      {.key = "c/0/1", .max_size = 10},
      {.key = "c/0/1", .offset = -4, .max_size = 10},
      {.key = "c/0/1", .offset = -4, .size = 2, .max_size = 2},
      {.key = "c/0/1", .offset = 3, .size = 3, .max_size = 10},
      {.key = "a=b +c", .max_size = 5},
      {.key = "link", .max_size = 6},
      {.key = "c/0/2", .max_size = 10},
      {.key = "c/0", .max_size = 10},
      {.key = "c/0/1", .max_size = 9},
      {.key = "c/0/1", .offset = 8, .size = 3, .max_size = 10},
      {.key = "c/0/1", .offset = -11, .max_size = 100},
      {.key = "../outside", .max_size = 10},
  };
  const auto answers = store->Read(reads, never_);
  ASSERT_EQ(answers.size(), reads.size());
  const std::vector<std::string> good = {"0123456789", "6789", "67", "345", "plain", "beyond"};
  for (std::size_t i = 0; i < good.size(); ++i) {
    ISOSCOPE_ASSERT_OK(answers[i]);
    EXPECT_EQ(*answers[i], good[i]);
  }
  EXPECT_THAT(answers[6], StatusIs(absl::StatusCode::kNotFound));
  EXPECT_THAT(answers[7], StatusIs(absl::StatusCode::kNotFound, HasSubstr("is a folder")));
  EXPECT_THAT(answers[8], StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("at most 9")));
  EXPECT_THAT(answers[9], StatusIs(absl::StatusCode::kOutOfRange, HasSubstr("ends after 10")));
  EXPECT_THAT(answers[10], StatusIs(absl::StatusCode::kOutOfRange));
  EXPECT_THAT(answers[11], StatusIs(absl::StatusCode::kInvalidArgument));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto object, store->Open("c/0/1", never_));
  EXPECT_EQ(object->size_bytes(), 10);
  EXPECT_THAT(store->Open("c/./1", never_), StatusIs(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(OpenFolderStore(dir_.Sub("none")), StatusIs(absl::StatusCode::kNotFound));
  EXPECT_THAT(OpenFolderStore(dir_.Sub("outside")),
              StatusIs(absl::StatusCode::kFailedPrecondition));
}

}  // namespace
}  // namespace isoscope::source
