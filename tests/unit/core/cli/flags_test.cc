#include "core/cli/flags.h"

#include <optional>
#include <string>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::cli {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

absl::StatusOr<int> ParseNumber(absl::string_view text) {
  int number = 0;
  if (text.empty()) {
    return -1;
  }
  if (!absl::SimpleAtoi(text, &number)) {
    return absl::InvalidArgumentError(absl::StrCat("'", text, "' is not a number"));
  }
  return number;
}

// One flag of each kind.
struct Numbers {
  std::optional<int> one;
  std::optional<int> optional;
  std::vector<int> list;
  std::vector<int> repeated;
};

absl::StatusOr<Numbers> Parse(const std::vector<std::string>& arguments) {
  FlagSet set;
  Numbers numbers;
  AddFlag(&set, "--one", "N", &numbers.one, ParseNumber, "");
  AddFlagWithDefault(&set, "--optional", "[N]", &numbers.optional, ParseNumber, "");
  AddListFlag(&set, "--list", "N", &numbers.list, ParseNumber, "");
  AddRepeatableFlag(&set, "--repeated", "N", &numbers.repeated, ParseNumber, "");
  ISOSCOPE_RETURN_IF_ERROR(set.Parse(arguments));
  return numbers;
}

TEST(FlagsTest, WithoutFlagsNothingIsStored) {
  const absl::StatusOr<Numbers> numbers = Parse({});
  ISOSCOPE_ASSERT_OK(numbers);
  EXPECT_FALSE(numbers->one.has_value());
  EXPECT_FALSE(numbers->optional.has_value());
  EXPECT_THAT(numbers->list, IsEmpty());
  EXPECT_THAT(numbers->repeated, IsEmpty());
}

TEST(FlagsTest, ValuesAreParsedOnceAndInOrder) {
  const absl::StatusOr<Numbers> numbers = Parse(
      {"--repeated", "4", "--list", "1", "2,3", "--one", "7", "--repeated", "5", "--optional=6"});
  ISOSCOPE_ASSERT_OK(numbers);
  EXPECT_EQ(numbers->one, 7);
  EXPECT_EQ(numbers->optional, 6);
  EXPECT_THAT(numbers->list, ElementsAre(1, 2, 3));
  EXPECT_THAT(numbers->repeated, ElementsAre(4, 5));
}

TEST(FlagsTest, AValueThatIsLeftOutIsAnEmptyText) {
  for (const std::vector<std::string>& arguments : std::vector<std::vector<std::string>>{
           {"--optional"}, {"--optional", "--one", "3"}, {"--optional=true"}, {"--optional", ""}}) {
    const absl::StatusOr<Numbers> numbers = Parse(arguments);
    ISOSCOPE_ASSERT_OK(numbers);
    EXPECT_EQ(numbers->optional, -1) << arguments.size();
  }
}

TEST(FlagsTest, ErrorsOfParsersHaveTheNameOfTheFlagBeforeThem) {
  for (const char* name : {"--one", "--optional", "--list", "--repeated"}) {
    EXPECT_THAT(Parse({name, "x"}), StatusIs(absl::StatusCode::kInvalidArgument,
                                             absl::StrCat(name, ": 'x' is not a number")));
  }
}

TEST(FlagsTest, TextMustNotBeEmpty) {
  EXPECT_EQ(*ParseText("a b"), "a b");
  EXPECT_THAT(ParseText(""), StatusIs(absl::StatusCode::kInvalidArgument, "is empty"));
}

}  // namespace
}  // namespace isoscope::cli
