#include "core/source/bytes/data_files.h"

#include <filesystem>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteFile;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

TEST(DataFilesTest, NumberedNamesAreToldFromOthers) {
  const struct {
    const char* text;
    const char* pattern;
    std::vector<std::int64_t> numbers;
  } rows[] = {{"quarter.%d 1 93 1", "quarter.%d", {1, 93, 1}},
              {"s%03d.raw\t10 2  -4 2", "s%03d.raw", {10, 2, -4, 2}},
              {"my scan %4i.raw 0 9 1", "my scan %4d.raw", {0, 9, 1}},
              {"%u", "%d", {}}};
  for (const auto& row : rows) {
    const std::optional<NumberedName> name = ParseNumberedName(row.text);
    ASSERT_TRUE(name.has_value()) << row.text;
    EXPECT_EQ(name->pattern, row.pattern);
    EXPECT_EQ(name->numbers, row.numbers);
  }
  for (const char* text : {"plain.raw", "100%.raw", "%", "a%", "a%03", "%s 1 2 1", "%n 1 2 1",
                           "%*d 1 2 1", "%99999d 1 2 1", "a%d 1 x 1", "a%d 1 99999999999 1"}) {
    EXPECT_FALSE(ParseNumberedName(text).has_value()) << text;
  }
}

class DataFilesOnDiskTest : public ::testing::Test {
 protected:
  DataFilesOnDiskTest() {
    for (int i = -2; i < 10; ++i) {
      WriteFile(dir_.Sub(absl::StrCat("s", i)), "x");
    }
    std::filesystem::create_directory(dir_.Sub("header"));
    header_ = dir_.Sub("header/h.nhdr");
  }
  auto Numbered(std::int64_t first, std::int64_t last, std::int64_t step,
                const FileShares& shares) const {
    return NumberedFiles(header_, "../s%d", first, last, step, shares);
  }
  std::string File(int i) const { return dir_.Sub(absl::StrCat("header/../s", i)); }

  TempDir dir_;
  std::string header_;
};

TEST_F(DataFilesOnDiskTest, NamesAreRelativeToTheHeaderOrAbsolute) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto beside, SingleFile(header_, "../s3"));
  EXPECT_THAT(beside, ElementsAre(File(3)));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto absolute, SingleFile(header_, dir_.Sub("s3")));
  EXPECT_THAT(absolute, ElementsAre(dir_.Sub("s3")));
  EXPECT_THAT(SingleFile(header_, "s3").status(),
              StatusIs(absl::StatusCode::kNotFound,
                       AllOf(HasSubstr(header_), HasSubstr(dir_.Sub("header/s3")))));
}

TEST_F(DataFilesOnDiskTest, NumbersRunUpAndDown) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto up, Numbered(1, 3, 1, {{4, 5, 3}, 2}));
  EXPECT_THAT(up, ElementsAre(File(1), File(2), File(3)));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto by_three, Numbered(-2, 5, 3, {{4, 5, 3}, 2}));
  EXPECT_THAT(by_three, ElementsAre(File(-2), File(1), File(4)));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto down, Numbered(5, 1, -2, {{4, 5, 3}, 2}));
  EXPECT_THAT(down, ElementsAre(File(5), File(3), File(1)));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto one, Numbered(7, 7, 1, {{4, 5, 3}, 3}));
  EXPECT_THAT(one, ElementsAre(File(7)));
}

TEST_F(DataFilesOnDiskTest, FilesHoldSlicesRowsOrSlabs) {
  ISOSCOPE_EXPECT_OK(Numbered(0, 5, 1, {{4, 3, 2}, 1}).status());  // a row each
  ISOSCOPE_EXPECT_OK(Numbered(0, 1, 1, {{4, 3, 2}, 2}).status());  // a slice each
  ISOSCOPE_EXPECT_OK(Numbered(0, 2, 1, {{4, 3, 6}, 3}).status());  // two slices each
  EXPECT_THAT(Numbered(0, 3, 1, {{4, 3, 6}, 3}).status(),
              StatusIs(kInvalid, HasSubstr("4 data files, which can't share")));
  EXPECT_THAT(
      Numbered(0, 4, 1, {{4, 3, 2}, 1}).status(),
      StatusIs(kInvalid, HasSubstr("5 data files of 1 axes each; 4 x 3 x 2 samples need 6")));
  EXPECT_THAT(Numbered(0, 4, 1, {{4, 3, 2}, 0}).status(), StatusIs(kInvalid, HasSubstr("0 axes")));
  EXPECT_THAT(Numbered(0, 4, 1, {{4, 3, 2}, 4}).status(), StatusIs(kInvalid, HasSubstr("4 axes")));
  EXPECT_THAT(Numbered(0, 4, 1, {{}, -1}).status(), StatusIs(kInvalid, HasSubstr("-1 axes")));
}

TEST_F(DataFilesOnDiskTest, MoreFilesThanAnyVolumeHasAreRefusedBeforeTheyAreNamed) {
  constexpr std::int64_t kMany = 2000000000;
  EXPECT_THAT(Numbered(0, kMany - 1, 1, {{4, 3, kMany}, 2}).status(),
              StatusIs(kInvalid, HasSubstr("2000000000 data files")));
  const std::int64_t huge = std::numeric_limits<std::int64_t>::max();
  for (const auto& [first, last, step] : std::vector<std::array<std::int64_t, 3>>{
           {1, 3, 0}, {1, 3, -1}, {3, 1, 1}, {-huge - 1, huge, 1}, {0, huge, huge}}) {
    EXPECT_THAT(Numbered(first, last, step, {{4, 3, 3}, 2}).status(),
                StatusIs(kInvalid, HasSubstr("expected a step")));
  }
}

TEST_F(DataFilesOnDiskTest, ListIsTakenAsItStandsAndNamesTheMissingFile) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files,
                                ListedFiles(header_, {"../s4", "../s1", "../s1"}, {{4, 3, 3}, 2}));
  EXPECT_THAT(files, ElementsAre(File(4), File(1), File(1)));
  EXPECT_THAT(ListedFiles(header_, {"../s4", "gone"}, {{4, 3, 2}, 2}).status(),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("header/gone does not exist")));
  EXPECT_THAT(ListedFiles(header_, {}, {{4, 3, 2}, 2}).status(),
              StatusIs(kInvalid, HasSubstr("0 data files")));
}

}  // namespace
}  // namespace isoscope::source
