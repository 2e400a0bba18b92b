#include "web-gateway/static_files.h"

#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/unit/web-gateway/header_of.h"

namespace isoscope::gateway {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

HttpResponse Get(const std::vector<std::string>& segments, const std::string& if_none_match = "") {
  return ServeStaticFile({.target = {.segments = segments}, .if_none_match = if_none_match});
}

TEST(StaticFilesTest, TheRootIsThePage) {
  const HttpResponse page = Get({});
  EXPECT_EQ(page.status, 200);
  EXPECT_EQ(page.content_type, "text/html; charset=utf-8");
  EXPECT_THAT(page.body, HasSubstr("<title>"));
  EXPECT_EQ(page.body, Get({"index.html"}).body);
}

TEST(StaticFilesTest, NothingInlineMayRun) {
  const std::string policy = HeaderOf(Get({}), "Content-Security-Policy");
  EXPECT_THAT(policy, HasSubstr("default-src 'none'"));
  EXPECT_THAT(policy, HasSubstr("script-src 'self';"));
  EXPECT_THAT(policy, HasSubstr("worker-src 'self' blob:"));
  EXPECT_THAT(policy, Not(HasSubstr("unsafe")));
}

TEST(StaticFilesTest, AFileThatTheBrowserHasIsNotSentAgain) {
  const std::string etag = HeaderOf(Get({}), "ETag");
  const HttpResponse again = Get({}, etag);
  EXPECT_EQ(again.status, 304);
  EXPECT_EQ(again.body, "");
  EXPECT_EQ(HeaderOf(again, "ETag"), etag);
}

TEST(StaticFilesTest, OtherPathsAreNotFound) {
  for (const std::vector<std::string>& segments : {std::vector<std::string>{"absent.js"},
                                                   {"index.html", "x"},
                                                   {"../index.html"},
                                                   {"web", "x"}}) {
    EXPECT_EQ(Get(segments).status, 404) << segments[0];
  }
}

TEST(StaticFilesTest, TypesBySuffix) {
  EXPECT_EQ(ContentTypeOf("a.js"), "text/javascript; charset=utf-8");
  EXPECT_EQ(ContentTypeOf("a.css"), "text/css; charset=utf-8");
  EXPECT_EQ(ContentTypeOf("a.svg"), "image/svg+xml");
  EXPECT_EQ(ContentTypeOf("a"), "application/octet-stream");
}

}  // namespace
}  // namespace isoscope::gateway
