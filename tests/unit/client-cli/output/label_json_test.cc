#include "client-cli/output/label_json.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

namespace isoscope::cli {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

TEST(LabelJsonTest, LabelsAreListedWithTheirColours) {
  Json json;
  AddLabels(
      {{.value = 1}, {.value = 17, .name = "left lung", .color = volume::LabelColor{1, 2, 255}}},
      &json);
  EXPECT_EQ(json["labels"].dump(), R"([{"value":1.0,"name":"","color":null},)"
                                   R"({"value":17.0,"name":"left lung","color":"#0102ff"}])");
  EXPECT_EQ(DescribeLabels(json),
            "\nlabel  colour     name\n"
            "    1  (#2a89e2)\n"
            "   17  #0102ff    left lung\n");
}

TEST(LabelJsonTest, NothingIsSaidOfADatasetWithoutLabels) {
  Json json = Json::object();
  AddLabels({}, &json);
  EXPECT_EQ(json.dump(), "{}");
  EXPECT_EQ(DescribeLabels(json), "");
}

TEST(LabelJsonTest, ALongListIsCutWithItsCountAndCannotReachTheTerminal) {
  std::vector<volume::Label> labels(102);
  for (std::size_t i = 0; i < labels.size(); ++i) {
    labels[i].value = static_cast<double>(i);
  }
  labels[0].name = "\x1b[2J";
  Json json;
  AddLabels(labels, &json);
  const std::string text = DescribeLabels(json);
  EXPECT_THAT(text, HasSubstr("and 2 more: --json lists all\n"));
  EXPECT_THAT(text, HasSubstr("\n   99  "));
  EXPECT_THAT(text, Not(HasSubstr("\n  100  ")));
  EXPECT_THAT(text, Not(HasSubstr("\x1b")));
}

}  // namespace
}  // namespace isoscope::cli
