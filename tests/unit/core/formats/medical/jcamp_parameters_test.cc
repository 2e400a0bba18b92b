#include "core/formats/medical/jcamp_parameters.h"

#include <cstdint>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

absl::StatusOr<JcampParameters> Read(const std::string& text) {
  const testing::TempDir dir;
  testing::WriteFile(dir.Sub("p"), text);
  return ReadJcampParameters(dir.Sub("p"));
}

TEST(JcampParametersTest, ScalarsArraysAndTexts) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const JcampParameters read,
      Read("##TITLE=a\r\n##$Dim=2\r\n##$Size=( 2, 2 )\r\n1 -2.5\r\n$$ 7 7\r\n3e2 4\r\n"
           "##$Name=( 65 )\n<a (b)>\n##$Empty=\n##$\n##END=\n##$Behind=1\n"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::int64_t dim, read.Count("Dim", 3));
  EXPECT_EQ(dim, 2);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto size, read.Numbers("Size"));
  EXPECT_THAT(size, ElementsAre(1, -2.5, 300, 4));
  EXPECT_EQ(read.Text("Name"), "<a (b)>");
  EXPECT_EQ(read.Text("TITLE"), "");
  for (const char* absent : {"Empty", "None", "Behind"}) {
    EXPECT_EQ(read.Text(absent), "");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto none, read.Numbers(absent));
    EXPECT_THAT(none, IsEmpty());
  }
}

TEST(JcampParametersTest, NumbersRepeat) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const JcampParameters read,
                                Read("##$A=( 8 )\n1 @2*(0 5) 2\n@1*(3)@2*(4)\n##END=\n"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto numbers, read.Numbers("A"));
  EXPECT_THAT(numbers, ElementsAre(1, 0, 5, 0, 5, 2, 3, 4, 4));
}

TEST(JcampParametersTest, NonsenseIsNamedWithItsText) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const JcampParameters read,
      Read("##$Word=( 2 )\n1 two\n##$Infinite=1e999\n##$Open=@2*(1\n##$Back=@2)*(1)\n##$Star=@2*1\n"
           "##$Many=@9000001*(1)\n##$Wrapped=@9223372036854775808*(1 1)\n##$Half=1.5\n##END=\n"));
  EXPECT_THAT(read.Numbers("Word"), StatusIs(kInvalid, HasSubstr("Word has \"two\"")));
  EXPECT_THAT(read.Numbers("Infinite"), StatusIs(kInvalid, HasSubstr("1e999")));
  for (const char* repeat : {"Open", "Back", "Star"}) {
    EXPECT_THAT(read.Numbers(repeat), StatusIs(kInvalid, HasSubstr("@COUNT*(NUMBERS)")));
  }
  for (const char* many : {"Many", "Wrapped"}) {
    EXPECT_THAT(read.Numbers(many), StatusIs(kInvalid, HasSubstr("more than 9000000 numbers")));
  }
  EXPECT_THAT(read.Numbers("Half", {2, 3}),
              StatusIs(kInvalid, HasSubstr("Half has 1 numbers; expected 2 or 3")));
  EXPECT_THAT(read.Count("Half", 3),
              StatusIs(kInvalid, HasSubstr("Half is \"1.5\"; expected 1 to 3")));
  EXPECT_THAT(read.Count("None", 3), StatusIs(kInvalid, HasSubstr("None is \"\"")));
}

TEST(JcampParametersTest, AFileWithoutAnEndIsCut) {
  EXPECT_THAT(Read("##$A=1\n"), StatusIs(kInvalid, AllOf(HasSubstr("/p: "), HasSubstr("##END"))));
  EXPECT_THAT(Read(""), StatusIs(kInvalid, HasSubstr("##END")));
  EXPECT_THAT(ReadJcampParameters("/nowhere/p").status(),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("/nowhere/p")));
}

}  // namespace
}  // namespace isoscope::source
