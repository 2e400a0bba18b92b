#include "core/source/remote/list_objects.h"

#include <map>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/source/remote/transfer_engine.h"
#include "tests/support/scripted_server.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/core/source/remote/remote_test.h"

namespace isoscope::source {
namespace {

using testing::Answer;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::ScriptedServer;
using testing::ServedConnection;
using testing::ServedRequest;
using testing::StatusIs;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

constexpr char kUrlEncoded[] = "<EncodingType>url</EncodingType>";

std::string S3List(const std::string& contents, const std::string& next = "",
                   const std::string& encoding = kUrlEncoded) {
  return absl::StrCat(
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<ListBucketResult "
      "xmlns=\"http://s3.amazonaws.com/doc/2006-03-01/\"><Name>b</Name><IsTruncated>",
      next.empty() ? "false" : "true", "</IsTruncated>", encoding,
      next.empty() ? "" : absl::StrCat("<NextContinuationToken>", next, "</NextContinuationToken>"),
      contents, "</ListBucketResult>");
}
std::string Contents(const std::string& key, const std::string& size = "3") {
  return absl::StrCat("<Contents><Key>", key, "</Key><ETag>&quot;e&quot;</ETag><Size>", size,
                      "</Size><Owner><ID>x</ID></Owner></Contents>");
}

TEST(ListObjectsTest, ReadsAListOfS3) {
  const auto page =
      ParseS3List(S3List(Contents("a/b%20c", "12") + Contents("a/d+e%2Bf", "0"), "t1&amp;2"));
  ASSERT_THAT(page.status(), testing::IsOk());
  ASSERT_EQ(page->objects.size(), 2u);
  EXPECT_EQ(page->objects[0].key, "a/b c");
  EXPECT_EQ(page->objects[0].size, 12);
  EXPECT_EQ(page->objects[1].key, "a/d e+f");
  EXPECT_EQ(page->next, "t1&2");
}

// s3rver, for one, gives keys as they are, whatever is asked for. Decoded all the same, "a+b" would be
// another object.
TEST(ListObjectsTest, KeysAreDecodedOnlyWhereTheListSaysSo) {
  const std::string contents = Contents("k=v+w/a %41.zarr/0") + Contents("100%");
  const auto page = ParseS3List(S3List(contents, "", ""));
  ASSERT_THAT(page.status(), testing::IsOk());
  ASSERT_EQ(page->objects.size(), 2u);
  EXPECT_EQ(page->objects[0].key, "k=v+w/a %41.zarr/0");
  EXPECT_EQ(page->objects[1].key, "100%");
  // Some say it behind the keys.
  const auto behind = ParseS3List(S3List(Contents("a%20b") + kUrlEncoded, "", ""));
  ASSERT_THAT(behind.status(), testing::IsOk());
  EXPECT_EQ(behind->objects.at(0).key, "a b");
}

TEST(ListObjectsTest, RefusesWhatIsNoListOfS3) {
  for (const std::string& text :
       {std::string(), std::string("<html></html>"), std::string("{}"), S3List(Contents("a", "-1")),
        S3List(Contents("a", "x")), S3List(Contents("%zz")), S3List(Contents("a")).substr(0, 150),
        S3List("<Contents>"), "<!DOCTYPE x [<!ENTITY a \"aaaa\">]>" + S3List(Contents("&a;")),
        S3List(Contents(std::string(10'000, 'k')))}) {
    EXPECT_THAT(ParseS3List(text).status(), StatusIs(kInvalid, HasSubstr("no list"))) << text;
  }
  std::string cut = S3List("", "t");
  cut.replace(cut.find("<NextC"), cut.find("</NextContinuationToken>") + 24 - cut.find("<NextC"),
              "");
  EXPECT_THAT(ParseS3List(cut).status(), StatusIs(kInvalid, HasSubstr("no token")));
}

TEST(ListObjectsTest, TakesTheLinksOfAnIndexThatLeadOneLevelBelow) {
  // As Apache, nginx and Python write them.
  EXPECT_THAT(NamesOfIndex(R"(<a href="?C=N;O=D">Name</a> <a href="/data/">Parent</a>
      <a href="../">..</a> <A HREF="a%20b.raw">a</A> <a href='c&amp;d/'>c</a> <a href="/data/x/e">e</a>
      <a href="a%20b.raw">again</a> <a href="./f">f</a>)",
                           "/data/x/"),
              ElementsAre("a b.raw", "c&d/", "e", "f"));
  EXPECT_THAT(NamesOfIndex(R"(<a href="https://host/x"> <a href="//host/x"> <a href="#a">
      <a href="mailto:a@b"> <a href="a/b"> <a href="%2e%2e/"> <a href="a%2fb"> <a href="%0a">
      <a href="/data/y"> <a href="/data/x/../y"> <a href=x> <a href="">)",
                           "/data/x/"),
              IsEmpty());
  EXPECT_THAT(NamesOfIndex("<a href=\"cut", "/"), IsEmpty());
}

class ListServerTest : public ::testing::Test {
 protected:
  ListServerTest()
      : server_([this](const ServedRequest& request, ServedConnection* connection) {
          const auto found = pages_.find(request.target);
          connection->Send(found == pages_.end() ? Answer(404, "", "")
                                                 : Answer(200, "", found->second));
        }),
        client_(
            [this] {
              RemoteOptions options = QuickOptions();
              options.s3.endpoint = server_.origin();
              options.s3.region = "eu-test-1";
              return options;
            }(),
            TransferEngine::OfProcess()) {}

  absl::StatusOr<std::vector<ListedObject>> List(const std::string& address) {
    const base::Cancellation never;
    return ListObjects(&client_, *ParseAddress(address), never);
  }
  static std::vector<std::string> KeysOf(const std::vector<ListedObject>& objects) {
    std::vector<std::string> keys;
    for (const ListedObject& object : objects) {
      keys.push_back(object.key);
    }
    return keys;
  }

  static constexpr char kQuery[] = "?encoding-type=url&list-type=2&prefix=";
  std::map<std::string, std::string> pages_;
  ScriptedServer server_;
  RemoteClient client_;
};

TEST_F(ListServerTest, ListsABucketPageByPage) {
  pages_[absl::StrCat("/bucket/", kQuery, "run.zarr%2F")] =
      S3List(Contents("run.zarr/b") + Contents("run.zarr/"), "t");
  pages_["/bucket/?continuation-token=t&encoding-type=url&list-type=2&prefix=run.zarr%2F"] =
      S3List(Contents("run.zarr/a/0", "7"));
  for (const char* const address : {"s3://bucket/run.zarr", "s3://bucket/run.zarr/"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto objects, List(address));
    EXPECT_THAT(KeysOf(objects), ElementsAre("a/0", "b"));
    EXPECT_EQ(objects[0].size, 7);
  }
}

TEST_F(ListServerTest, NoKeyLeadsOutOfTheFolder) {
  for (const char* const key : {"p/../x", "p//x", "p/./x", "other/x", "p/a%0Ab"}) {
    pages_[absl::StrCat("/bucket/", kQuery, "p%2F")] = S3List(Contents(key));
    EXPECT_THAT(List("s3://bucket/p/").status(), StatusIs(kInvalid)) << key;
  }
  pages_[absl::StrCat("/bucket/", kQuery, "p%2F")] = S3List("");
  EXPECT_THAT(List("s3://bucket/p/").status(), StatusIs(absl::StatusCode::kNotFound));
  // The same page for ever.
  pages_[absl::StrCat("/bucket/", kQuery, "p%2F")] = S3List(Contents("p/x"), "t");
  pages_["/bucket/?continuation-token=t&encoding-type=url&list-type=2&prefix=p%2F"] =
      S3List(Contents("p/x"), "t");
  EXPECT_THAT(List("s3://bucket/p/").status(), StatusIs(kInvalid, HasSubstr("same page")));
}

TEST_F(ListServerTest, ListsTheFoldersOfAnIndex) {
  pages_["/d/"] = "<a href=\"a%20b\">x</a><a href=\"sub/\">s</a><a href=\"../\">up</a>";
  pages_["/d/sub/"] = "<a href=\"0\">0</a><a href=\"deep/\">d</a>";
  pages_["/d/sub/deep/"] = "<a href=\"1\">1</a>";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto objects, List(server_.origin() + "/d"));
  EXPECT_THAT(KeysOf(objects), ElementsAre("a b", "sub/0", "sub/deep/1"));
  pages_["/empty/"] = "<html>no links</html>";
  EXPECT_THAT(List(server_.origin() + "/empty/").status(),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("no index")));
}

// Nginx lists no name that begins with '.'.
TEST_F(ListServerTest, FindsTheHiddenMetadataOfZarr) {
  pages_["/d/"] = "<a href=\"run.zarr/\">x</a>";
  pages_["/d/run.zarr/"] = "<a href=\"a/\">a</a>";
  pages_["/d/run.zarr/.zgroup"] = "{}";
  pages_["/d/run.zarr/a/"] = "<a href=\"0/\">0</a>";
  pages_["/d/run.zarr/a/.zarray"] = "{}";
  pages_["/d/run.zarr/a/.zattrs"] = "{}";
  pages_["/d/run.zarr/a/0/"] = "<a href=\"0\">0</a>";
  pages_["/d/run.zarr/a/0/.zarray"] = "of nobody";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto objects, List(server_.origin() + "/d/"));
  EXPECT_THAT(KeysOf(objects), ElementsAre("run.zarr/.zgroup", "run.zarr/a/.zarray",
                                           "run.zarr/a/.zattrs", "run.zarr/a/0/0"));
}

TEST_F(ListServerTest, FoldersWithoutEndAreRefused) {
  std::string path = "/d/";
  for (int i = 0; i < 40; ++i) {
    pages_[path] = "<a href=\"d/\">d</a>";
    path += "d/";
  }
  EXPECT_THAT(List(server_.origin() + "/d/").status(),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("deep")));
}

}  // namespace
}  // namespace isoscope::source
