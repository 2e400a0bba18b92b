#include "web-gateway/http/static_files.h"

#include <regex>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/unit/web-gateway/header_of.h"

namespace isoscope::gateway {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

HttpResponse Get(const std::vector<std::string>& segments, const std::string& if_none_match = "",
                 const std::string& version = "") {
  Target target{.segments = segments};
  if (!version.empty()) {
    target.query = {{"v", version}};
  }
  return ServeStaticFile({.target = target, .if_none_match = if_none_match},
                         PagePolicy(/*framing_origins=*/{}));
}

// Names and digests of the files that the page names with one: "bundle.js?v=0123".
std::vector<std::pair<std::string, std::string>> FilesOfPage() {
  std::vector<std::pair<std::string, std::string>> files;
  const std::string page = Get({}).body;
  static const std::regex address(R"re( (?:href|src)="([a-z.-]+)\?v=([0-9a-f]+)")re");
  for (std::sregex_iterator it(page.begin(), page.end(), address), end; it != end; ++it) {
    files.emplace_back((*it)[1], (*it)[2]);
  }
  return files;
}

TEST(StaticFilesTest, TheRootIsThePage) {
  const HttpResponse page = Get({});
  EXPECT_EQ(page.status, 200);
  EXPECT_EQ(page.content_type, "text/html; charset=utf-8");
  EXPECT_THAT(page.body, HasSubstr("<title>"));
  EXPECT_EQ(page.body, Get({"index.html"}).body);
}

TEST(StaticFilesTest, TheModulesOfTheViewLieInAFolder) {
  const HttpResponse module = Get({"view", "camera.js"});
  EXPECT_EQ(module.status, 200);
  EXPECT_EQ(module.content_type, "text/javascript; charset=utf-8");
  EXPECT_EQ(Get({"view"}).status, 404);
  EXPECT_EQ(Get({"camera.js"}).status, 404);
}

// Each import of each file is served: a module that the build forgets leaves the page empty.
TEST(StaticFilesTest, EveryImportIsServed) {
  size_t imports = 0;
  for (const StaticFile& file : StaticFiles()) {
    const std::vector<std::string> folder = absl::StrSplit(file.name, '/');
    std::string text(file.content);
    static const std::regex import("from '\\./([^']+)'");
    for (std::sregex_iterator it(text.begin(), text.end(), import), end; it != end; ++it) {
      std::vector<std::string> path(folder.begin(), folder.end() - 1);
      for (absl::string_view segment : absl::StrSplit((*it)[1].str(), '/')) {
        path.emplace_back(segment);
      }
      EXPECT_EQ(Get(path).status, 200) << file.name << " imports " << (*it)[1];
      ++imports;
    }
  }
  EXPECT_GT(imports, 50);
}

// A browser asks once for what it runs, and not module by module.
TEST(StaticFilesTest, ThePageRunsOneModule) {
  const std::string page = Get({}).body;
  EXPECT_EQ(page.find("<script"), page.rfind("<script"));
  EXPECT_THAT(page, HasSubstr(R"(<script type="module" src="bundle.js?v=)"));
  EXPECT_THAT(page, Not(HasSubstr("modulepreload")));
  const HttpResponse bundle = Get({"bundle.js"});
  EXPECT_EQ(bundle.content_type, "text/javascript; charset=utf-8");
  EXPECT_THAT(bundle.body, HasSubstr("loadDatasets();"));
  EXPECT_THAT(bundle.body, Not(HasSubstr("\nimport ")));
}

TEST(StaticFilesTest, FilesAreKeptByTheirDigestAlone) {
  const auto files = FilesOfPage();
  EXPECT_THAT(files, testing::SizeIs(testing::Ge(3U)));
  for (const auto& [name, digest] : files) {
    const HttpResponse kept = Get({name}, /*if_none_match=*/"", digest);
    EXPECT_EQ(kept.status, 200) << name;
    EXPECT_EQ(HeaderOf(kept, "Cache-Control"), "public, max-age=31536000, immutable") << name;
    EXPECT_EQ(HeaderOf(kept, "ETag"), absl::StrCat("\"", digest, "\"")) << name;
    EXPECT_EQ(HeaderOf(Get({name}), "Cache-Control"), "no-cache") << name;
    const HttpResponse other = Get({name}, /*if_none_match=*/"", std::string(digest.size(), '0'));
    EXPECT_EQ(other.body, kept.body) << "a page of another version still works";
    EXPECT_EQ(HeaderOf(other, "Cache-Control"), "no-cache") << name;
  }
  EXPECT_EQ(HeaderOf(Get({}), "Cache-Control"), "no-cache");
}

TEST(StaticFilesTest, WhoeverAcceptsGzipGetsIt) {
  const HttpRequest plain{.target = {.segments = {"bundle.js"}}};
  HttpRequest packed = plain;
  packed.accept_encoding = "gzip, deflate, br";
  const HttpResponse whole = ServeStaticFile(plain, "");
  const HttpResponse gzip = ServeStaticFile(packed, "");
  EXPECT_EQ(HeaderOf(whole, "Content-Encoding"), "");
  EXPECT_EQ(HeaderOf(gzip, "Content-Encoding"), "gzip");
  EXPECT_TRUE(absl::StartsWith(gzip.body, "\x1f\x8b"));
  EXPECT_LT(gzip.body.size(), whole.body.size() / 2);
  EXPECT_EQ(gzip.content_type, whole.content_type);
  EXPECT_NE(HeaderOf(gzip, "ETag"), HeaderOf(whole, "ETag"));
  for (const HttpResponse& response : {whole, gzip}) {
    EXPECT_THAT(HeaderOf(response, "Vary"), HasSubstr("Accept-Encoding"));
  }
  packed.if_none_match = HeaderOf(gzip, "ETag");
  EXPECT_EQ(ServeStaticFile(packed, "").status, 304);
  packed.target.segments = {"view", "camera.js"};
  EXPECT_EQ(HeaderOf(ServeStaticFile(packed, ""), "Content-Encoding"), "") << "only as it is";
  EXPECT_EQ(Get({"bundle.js.gz"}).status, 404);
}

TEST(StaticFilesTest, GzipIsAcceptedByNameAndWeight) {
  for (const absl::string_view header : {"gzip", "br, GZIP;q=0.5", "deflate,gzip ; q=1"}) {
    EXPECT_TRUE(AcceptsGzip(header)) << header;
  }
  for (const absl::string_view header : {"", "br", "gzip;q=0", "br, gzip; q=0.000", "xgzip"}) {
    EXPECT_FALSE(AcceptsGzip(header)) << header;
  }
}

TEST(StaticFilesTest, NothingInlineMayRun) {
  const std::string policy = HeaderOf(Get({}), "Content-Security-Policy");
  EXPECT_THAT(policy, HasSubstr("default-src 'none'"));
  EXPECT_THAT(policy, HasSubstr("script-src 'self';"));
  EXPECT_THAT(policy, HasSubstr("worker-src 'self' blob:"));
  EXPECT_THAT(policy, Not(HasSubstr("unsafe")));
}

TEST(StaticFilesTest, OnlyThePagesOfNamedOriginsMayFrameIt) {
  EXPECT_TRUE(absl::EndsWith(PagePolicy({}), "; frame-ancestors 'self'"));
  const std::string policy = PagePolicy({"https://hub.org", "http://localhost:8888"});
  EXPECT_TRUE(
      absl::EndsWith(policy, "; frame-ancestors 'self' https://hub.org http://localhost:8888"));
  EXPECT_EQ(HeaderOf(ServeStaticFile({}, policy), "Content-Security-Policy"), policy);
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
