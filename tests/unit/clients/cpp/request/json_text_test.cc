#include "clients/cpp/request/json_text.h"

#include <string>

#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

namespace isoscope::client {
namespace {

using Json = nlohmann::ordered_json;

TEST(JsonTextTest, NamesFromElsewhereDoNotSteerTheTerminal) {
  const std::string name = "\x1b]0;title\x07\u009b2J\x7f\u00e4";
  const std::string text = JsonText(Json{{"name", name}});
  EXPECT_EQ(text, "{\n  \"name\": \"\\u001b]0;title\\u0007\\u009b2J\\u007f\u00e4\"\n}\n");
  EXPECT_EQ(Json::parse(text)["name"], name) << "the same value for scripts";
}

TEST(JsonTextTest, ANameThatIsNoUtf8IsNoCrash) {
  EXPECT_EQ(JsonText(Json("a\xff")), "\"a\ufffd\"\n");
}

}  // namespace
}  // namespace isoscope::client
