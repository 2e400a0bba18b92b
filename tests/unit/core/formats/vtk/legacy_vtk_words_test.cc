#include "core/formats/vtk/legacy_vtk_words.h"

#include <memory>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

class LegacyWordsTest : public ::testing::Test {
 protected:
  LegacyWords Words(const std::string& bytes) {
    testing::WriteFile(dir_.Sub("a.vtk"), bytes);
    file_ = *io::OpenRandomAccessFile(dir_.Sub("a.vtk"));
    return LegacyWords(file_.get());
  }
  testing::TempDir dir_;
  std::unique_ptr<io::RandomAccessFile> file_;
};

TEST_F(LegacyWordsTest, ReadsWordsNumbersAndVectors) {
  LegacyWords words = Words("dimensions 12 1.5 -2 3e1\nrest");
  EXPECT_EQ(*words.NextKeyword(), "DIMENSIONS");
  EXPECT_EQ(*words.NextCount("n", 1, 12), 12);
  EXPECT_EQ(*words.NextVector("v"), (math::Vec3d{1.5, -2, 30}));
  EXPECT_EQ(*words.NextLine(), "");
  EXPECT_EQ(*words.NextText(), "rest");
  EXPECT_TRUE(words.is_at_end());
  EXPECT_EQ(*words.NextKeyword(), "");
  EXPECT_THAT(words.NextText().status(), StatusIs(kInvalid, HasSubstr("ends within")));
}

TEST_F(LegacyWordsTest, PassesArraysByTheirSizeAndChecksIt) {
  LegacyWords words = Words("1 2 3 4 5 6 next");
  ISOSCOPE_EXPECT_OK(words.PassNumbers(3, 2, 32, false));
  EXPECT_EQ(*words.NextText(), "next");
  words = Words("abcdefghi next");
  ISOSCOPE_EXPECT_OK(words.PassNumbers(3, 3, 8, true));
  EXPECT_EQ(*words.NextText(), "next");
  words = Words("ab next");
  ISOSCOPE_EXPECT_OK(words.PassNumbers(1, 9, 1, true));  // 9 bits
  EXPECT_EQ(*words.NextText(), "next");
  EXPECT_THAT(Words("abc").PassNumbers(1, 4, 8, true), StatusIs(kInvalid, HasSubstr("cut")));
  EXPECT_THAT(Words("1 2 3").PassNumbers(1, 4, 8, false), StatusIs(kInvalid, HasSubstr("cut")));
  EXPECT_THAT(Words("1     2").PassNumbers(1, 3, 8, false), StatusIs(kInvalid, HasSubstr("cut")));
}

TEST_F(LegacyWordsTest, PassesTexts) {
  LegacyWords words = Words("one line\n\nanother\nnext");
  ISOSCOPE_EXPECT_OK(words.PassTexts(3, false));
  EXPECT_EQ(*words.NextText(), "next");
  // Lengths of 1, 2 and 4 bytes.
  words = Words(std::string("\xc2") + "ab" + std::string("\x80\x01", 2) + "c" +
                std::string("\x40\0\0\x02", 4) + "de next");
  ISOSCOPE_EXPECT_OK(words.PassTexts(3, true));
  EXPECT_EQ(*words.NextText(), "next");
  EXPECT_FALSE(Words("\xff").PassTexts(1, true).ok());
  EXPECT_FALSE(Words(std::string(8, '\0') + "x").PassTexts(1 << 20, true).ok());
}

TEST_F(LegacyWordsTest, RefusesWhatIsNoNumber) {
  EXPECT_THAT(
      Words("-1").NextCount("DIMENSIONS has", 1, 9).status(),
      StatusIs(kInvalid, HasSubstr("DIMENSIONS has \"-1\"; expected a number from 1 to 9")));
  EXPECT_FALSE(Words("9999999999999999999999").NextCount("n", 1, 9).ok());
  EXPECT_FALSE(Words("1 x 2").NextVector("ORIGIN").ok());
  EXPECT_FALSE(Words("1 2").NextVector("ORIGIN").ok());
  EXPECT_FALSE(Words(std::string(2000, 'x')).NextText().ok());
}

}  // namespace
}  // namespace isoscope::source
