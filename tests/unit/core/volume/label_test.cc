#include "core/volume/label.h"

#include <cmath>
#include <limits>
#include <set>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::volume {
namespace {

using ::isoscope::testing::IsOk;
using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

TEST(LabelTest, LabelsAreFoundByTheirValueAlone) {
  std::vector<Label> labels{{.value = 7, .name = "seven"}, {.value = -0.0}, {.value = 2.5}};
  SortLabels(&labels);
  ASSERT_THAT(ValidateLabels(labels), IsOk());
  ASSERT_NE(FindLabel(labels, 7), nullptr);
  EXPECT_EQ(FindLabel(labels, 7)->name, "seven");
  EXPECT_NE(FindLabel(labels, 2.5), nullptr);
  EXPECT_FALSE(std::signbit(FindLabel(labels, 0)->value));
  EXPECT_EQ(FindLabel(labels, 2), nullptr);
  EXPECT_EQ(FindLabel(labels, 8), nullptr);
  EXPECT_EQ(FindLabel({}, 0), nullptr);
}

TEST(LabelTest, LabelsThatNoDatasetCanHoldAreRefusedWithTheirValue) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const auto refuses = [](const std::vector<Label>& labels, const char* what) {
    EXPECT_THAT(ValidateLabels(labels),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(what)));
  };
  refuses({{.value = kInfinity}}, "inf");
  refuses({{.value = std::nan("")}}, "nan");
  refuses({{.value = 3}, {.value = 3}}, "the label 3 comes after 3");
  refuses({{.value = 4}, {.value = 3}}, "the label 3 comes after 4");
  refuses({{.value = 5, .name = std::string(257, 'n')}}, "label 5 has 257 bytes");
  refuses({{.value = 6, .name = "a\x1b[2J"}}, "label 6");
  refuses({{.value = 6, .name = "\xff"}}, "no UTF-8");
  refuses({{.value = 6, .name = "two\nlines"}}, "control");
  EXPECT_THAT(ValidateLabels({{.value = 5, .name = std::string(256, 'n')}}), IsOk());
  std::vector<Label> many(kMaxNamedLabels);
  for (std::size_t i = 0; i < many.size(); ++i) {
    many[i].value = static_cast<double>(i);
  }
  EXPECT_THAT(ValidateLabels(many), IsOk());
  many.push_back({.value = 1e9});
  refuses(many, "65537 labels");
  many.pop_back();
  for (Label& label : many) {
    label.name = std::string(65, 'n');
  }
  refuses(many, "bytes together");
}

TEST(LabelTest, ANameIsCleanedByWholeCharacters) {
  EXPECT_EQ(CleanLabelName("  left hippocampus\t"), "left hippocampus");
  EXPECT_EQ(CleanLabelName("a\x1b[2Jb\xff"), "a?[2Jb?");
  // 255 bytes and a character of two: the whole character goes.
  EXPECT_EQ(CleanLabelName(std::string(255, 'n') + "\xc3\xa9"), std::string(255, 'n'));
  EXPECT_EQ(CleanLabelName(std::string(254, 'n') + "\xc3\xa9!"),
            std::string(254, 'n') + "\xc3\xa9");
  EXPECT_EQ(CleanLabelName(""), "");
  for (const char* text : {"\xf0\x9f\xa7\xa0", "\xed\xa0\x80", "\0", "\r\n"}) {
    EXPECT_THAT(ValidateLabels({{.name = CleanLabelName(text)}}), IsOk());
  }
}

TEST(LabelTest, SixteenNeighboursHaveSixteenColoursAndTheyRepeat) {
  std::set<std::string> colors;
  for (int value = 0; value < 16; ++value) {
    colors.insert(ToHex(DefaultLabelColor(value)));
    EXPECT_EQ(DefaultLabelColor(value), DefaultLabelColor(value + 16));
    EXPECT_EQ(DefaultLabelColor(value), DefaultLabelColor(value - 160));
    EXPECT_EQ(DefaultLabelColor(value), DefaultLabelColor(value + 0.75));
  }
  EXPECT_EQ(colors.size(), 16U);
  EXPECT_EQ(ToHex(DefaultLabelColor(1)), "#2a89e2");
  EXPECT_EQ(ToHex(DefaultLabelColor(-1)), "#94bf41");
  EXPECT_EQ(DefaultLabelColor(1e300), DefaultLabelColor(1e300));
}

TEST(LabelTest, AColourComesBackFromItsText) {
  const LabelColor color{.red = 1, .green = 0xab, .blue = 255};
  EXPECT_EQ(ToHex(color), "#01abff");
  EXPECT_EQ(LabelColorFromHex("#01ABff"), color);
  for (const char* text : {"", "#", "01abff", "#01abf", "#01abfff", "#01abfg", "#-1abff"}) {
    EXPECT_FALSE(LabelColorFromHex(text).has_value()) << text;
  }
}

}  // namespace
}  // namespace isoscope::volume
