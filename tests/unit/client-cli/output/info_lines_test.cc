#include "client-cli/output/info_lines.h"

#include <limits>

#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

namespace isoscope::cli {
namespace {

TEST(InfoLinesTest, TextOfAServerDoesNotSteerTheTerminal) {
  const Json json{{"name", "a\x1b[2J"}, {"unit", TextOrNull("")}};
  EXPECT_EQ(TextOf(json, "name").find('\x1b'), std::string::npos);
  EXPECT_EQ(TextOf(json, "unit"), "");
}

TEST(InfoLinesTest, AnInfiniteNumberOfAListIsNotNull) {
  const Json range = Json::array({-1.0, std::numeric_limits<double>::infinity()});
  EXPECT_EQ(Joined(range, " to "), "-1.0 to inf");
}

TEST(InfoLinesTest, ValuesBeginInOneColumn) {
  std::string text;
  AddLine("id", "7", &text);
  AddLine("distribution", "random", &text);
  EXPECT_EQ(text, "id            7\ndistribution  random\n");
}

}  // namespace
}  // namespace isoscope::cli
