#include "core/synthetic/generated_file.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::IsOk;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::HasSubstr;

// Rows of one letter each: row r is the letter r modulo 26.
RowSource Letters(std::int64_t row_count, std::int64_t row_bytes) {
  return {.row_count = row_count,
          .row_bytes = row_bytes,
          .fill = [row_bytes](std::int64_t begin, std::int64_t end, char* out) {
            EXPECT_EQ(begin % 4, 0);
            for (std::int64_t row = begin; row < end; ++row) {
              std::fill_n(out + (row - begin) * row_bytes, row_bytes,
                          static_cast<char>('a' + row % 26));
            }
          }};
}

TEST(AppendRowsTest, RowsComeInOrderWhateverTheirSize) {
  for (const std::int64_t row_bytes : {1, 1000, 700000, 3000000}) {
    for (const std::int64_t row_count : {1, 4, 23}) {
      const RowSource rows = Letters(row_count, row_bytes);
      std::string expected(static_cast<std::size_t>(row_count * row_bytes), '\0');
      rows.fill(0, row_count, expected.data());
      std::string appended;
      EXPECT_THAT(AppendRows(
                      rows,
                      [&](absl::string_view bytes) {
                        appended.append(bytes.data(), bytes.size());
                        return absl::OkStatus();
                      },
                      base::Cancellation()),
                  IsOk());
      EXPECT_TRUE(appended == expected) << row_count << " of " << row_bytes;
    }
  }
}

TEST(AppendRowsTest, FirstErrorEndsTheWork) {
  int calls = 0;
  EXPECT_THAT(AppendRows(
                  Letters(1000, 1000000),
                  [&](absl::string_view) {
                    return ++calls == 2 ? absl::DataLossError("second") : absl::OkStatus();
                  },
                  base::Cancellation()),
              StatusIs(absl::StatusCode::kDataLoss, "second"));
  EXPECT_EQ(calls, 2);
}

TEST(AppendRowsTest, CancellationEndsTheWork) {
  base::Cancellation cancellation;
  std::int64_t appended = 0;
  EXPECT_THAT(AppendRows(
                  Letters(1000, 1000000),
                  [&](absl::string_view bytes) {
                    appended += static_cast<std::int64_t>(bytes.size());
                    cancellation.Cancel();
                    return absl::OkStatus();
                  },
                  cancellation),
              StatusIs(absl::StatusCode::kCancelled, ::testing::_));
  EXPECT_LT(appended, 1000000000);
}

TEST(GeneratedFileTest, SpaceThatIsNotThereIsRefusedWithAdvice) {
  const TempDir dir;
  EXPECT_THAT(CheckFreeSpace(dir.Sub("v"), 1, "less"), IsOk());
  EXPECT_THAT(CheckFreeSpace(dir.Sub("v"), std::numeric_limits<std::int64_t>::max(), "less"),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("left: less")));
  EXPECT_THAT(CheckFreeSpace(dir.Sub("absent/v"), 1, "less"), IsOk());
}

TEST(GeneratedFileTest, FolderIsNoFile) {
  const TempDir dir;
  EXPECT_THAT(CheckNoFolder(dir.path()),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr(dir.path())));
  EXPECT_THAT(CheckNoFolder(dir.Sub("v")), IsOk());
}

}  // namespace
}  // namespace isoscope::source
