#include "core/source/bytes/local_bytes.h"

#include <memory>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::IsOk;
using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

TEST(LocalBytesTest, ReadsRangesOfAFile) {
  const testing::TempDir dir;
  const std::string path = dir.Write("a", "0123456789");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto bytes, OpenFileBytes(path));
  EXPECT_EQ(bytes->size_bytes(), 10);
  EXPECT_EQ(bytes->name(), path);
  const base::Cancellation never;
  std::string a(3, '?');
  std::string b(10, '?');
  const std::vector<ByteRange> ranges = {{.offset = 7, .size = 3, .out = a.data()},
                                         {.offset = 0, .size = 10, .out = b.data()}};
  ISOSCOPE_ASSERT_OK(bytes->ReadRanges(ranges, never));
  EXPECT_EQ(a + b, "7890123456789");
  for (const ByteRange& bad :
       {ByteRange{.offset = -1, .size = 1}, ByteRange{.offset = 10, .size = 1},
        ByteRange{.offset = 11, .size = 0}}) {
    EXPECT_THAT(bytes->ReadAt(bad.offset, bad.size, a.data(), never),
                StatusIs(absl::StatusCode::kOutOfRange));
  }
  base::Cancellation cancelled;
  cancelled.Cancel();
  EXPECT_THAT(bytes->ReadAt(0, 1, a.data(), cancelled), StatusIs(absl::StatusCode::kCancelled));
  EXPECT_THAT(OpenFileBytes(dir.Sub("b")), StatusIs(absl::StatusCode::kNotFound));
}

TEST(LocalBytesTest, ReadsObjectsOfAFolder) {
  const testing::TempDir dir;
  dir.Write("c/0/1", "0123456789");
  dir.Write("x", "y");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto store, OpenFolderStore(dir.path()));
  const base::Cancellation never;
  const std::vector<ObjectRead> reads = {{.key = "c/0/1", .max_size = 10},
                                         {.key = "c/0/1", .offset = -3, .max_size = 10},
                                         {.key = "c/0/1", .offset = 2, .size = 4, .max_size = 4},
                                         {.key = "c/0/2", .max_size = 1},
                                         {.key = "c/0", .max_size = 1},
                                         {.key = "c/0/1", .max_size = 9},
                                         {.key = "c/0/1", .offset = 8, .size = 3, .max_size = 9},
                                         {.key = "c/0/1", .offset = -11, .max_size = 20},
                                         {.key = "../x", .max_size = 9},
                                         {.key = "c//0/1", .max_size = 10},
                                         {.key = "", .max_size = 10},
                                         {.key = "x", .max_size = 9}};
  const auto parts = store->Read(reads, never);
  EXPECT_EQ(*parts[0] + "," + *parts[1] + "," + *parts[2] + "," + *parts[11],
            "0123456789,789,2345,y");
  EXPECT_THAT(parts[3], StatusIs(absl::StatusCode::kNotFound));
  EXPECT_THAT(parts[4], StatusIs(absl::StatusCode::kNotFound));
  EXPECT_THAT(parts[5], StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("10 bytes")));
  EXPECT_THAT(parts[6], StatusIs(absl::StatusCode::kOutOfRange));
  EXPECT_THAT(parts[7], StatusIs(absl::StatusCode::kOutOfRange));
  for (const std::size_t bad : {8U, 9U, 10U}) {
    EXPECT_THAT(parts[bad], StatusIs(absl::StatusCode::kInvalidArgument));
  }
  EXPECT_THAT(OpenFolderStore(dir.Sub("none")), StatusIs(absl::StatusCode::kNotFound));
  EXPECT_THAT(OpenFolderStore(dir.Sub("x")), StatusIs(absl::StatusCode::kInvalidArgument));
}

}  // namespace
}  // namespace isoscope::source
