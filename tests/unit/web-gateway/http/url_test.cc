#include "web-gateway/http/url.h"

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::gateway {
namespace {

using ::testing::HasSubstr;
using testing::IsOk;
using testing::StatusIs;

TEST(UrlTest, SplitsAndDecodes) {
  const struct {
    std::string target;
    Target expected;
  } cases[] = {
      {"/", {}},
      {"/page.js", {.segments = {"page.js"}}},
      {"//v1///datasets/", {.segments = {"v1", "datasets"}}},
      {"/v1/datasets/a%2Fb%20c", {.segments = {"v1", "datasets", "a/b c"}}},
      {"/a+b", {.segments = {"a+b"}}},  // a space in a query only
      {"/?a=1&b=&c&a=2", {.query = {{"a", "1"}, {"b", ""}, {"c", ""}, {"a", "2"}}}},
      {"/?x=a+b%2B%3D=c", {.query = {{"x", "a b+==c"}}}},
      {"/?&&a=1&", {.query = {{"a", "1"}}}},
      {"/%C3%BC", {.segments = {"\xC3\xBC"}}},
  };
  for (const auto& c : cases) {
    const absl::StatusOr<Target> parsed = ParseTarget(c.target);
    ASSERT_THAT(parsed, IsOk()) << c.target;
    EXPECT_EQ(*parsed, c.expected) << c.target;
  }
}

TEST(UrlTest, RefusesWhatIsNoTarget) {
  for (const std::string& target :
       std::vector<std::string>{"",         "*",           "v1",     "ftp://host/",
                                "host:80",  "/%",          "/%2",    "/%zz",
                                "/a?b=%g0", "/%00",        "/a%0Ab", "/?a=%0d",
                                "/%ff",     "/?a=%c3",     "/\xff",  "http://host/",
                                "/..",      "/a/%2e%2E/b", "/./a",   std::string("/a\0b", 4),
                                "/\x7f"}) {
    EXPECT_THAT(ParseTarget(target).status(), StatusIs(absl::StatusCode::kInvalidArgument))
        << target;
  }
}

TEST(UrlTest, QuotesWithoutControlCharactersAndNotWithoutEnd) {
  const std::string message(
      ParseTarget(absl::StrCat("/\x1b[2J", std::string(10000, 'x'))).status().message());
  EXPECT_EQ(message.find('\x1b'), std::string::npos);
  EXPECT_LT(message.size(), 400U);
}

TEST(UrlTest, LimitsTheNumberOfParameters) {
  std::string query = "/?";
  for (std::size_t i = 0; i < kMaxQueryParameters; ++i) {
    query += "a=1&";
  }
  EXPECT_THAT(ParseTarget(query), IsOk());
  EXPECT_THAT(ParseTarget(query + "a=1"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("128 parameters")));
}

TEST(UrlTest, TakesAParameterOutWhereverItStands) {
  Target target{.query = {{"a", "1"}, {"token", "x"}, {"b", "2"}, {"token", "y"}}};
  EXPECT_EQ(target.TakeParameter("token"), "x");
  EXPECT_EQ(target, (Target{.query = {{"a", "1"}, {"b", "2"}}}));
  EXPECT_EQ(target.TakeParameter("token"), "");
}

TEST(UrlTest, EscapedValuesComeBack) {
  std::string all = "\u00e4\u2013\U0001f480";
  for (int byte = 32; byte < 127; ++byte) {
    all += static_cast<char>(byte);
  }
  const absl::StatusOr<Target> parsed = ParseTarget(absl::StrCat("/?x=", EscapeQueryValue(all)));
  ASSERT_THAT(parsed, IsOk());
  EXPECT_EQ(parsed->query[0].second, all);
}

}  // namespace
}  // namespace isoscope::gateway
