#include "core/http/peer_message.h"

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::http {
namespace {

using ::isoscope::testing::StatusIs;

constexpr std::size_t kPiece = UnsentAnswer::kPieceBytes;

TEST(PeerFieldsTest, AFieldIsSetOnceWhateverItsCase) {
  struct Case {
    PeerFields before;
    std::string name;
    PeerFields after;
  };
  const std::vector<Case> cases = {
      {{}, "A", {{"A", "new"}}},
      {{{"A", "1"}}, "B", {{"A", "1"}, {"B", "new"}}},
      {{{"A", "1"}, {"B", "2"}}, "A", {{"B", "2"}, {"A", "new"}}},
      {{{"x-a", "1"}, {"B", "2"}, {"X-A", "3"}}, "X-a", {{"B", "2"}, {"X-a", "new"}}},
  };
  for (const Case& c : cases) {
    PeerFields fields = c.before;
    SetField(c.name, "new", &fields);
    EXPECT_EQ(fields, c.after) << c.name;
  }
}

TEST(PeerRequestTest, AFieldIsFoundWhateverItsCase) {
  PeerRequest request;
  request.fields = {{"Host", "here"}, {"Cookie", "a"}, {"cookie", "b"}, {"Empty", ""}};
  struct Case {
    std::string name;
    std::string value;
    int count;
  };
  for (const Case& c : std::vector<Case>{{"host", "here", 1},
                                         {"COOKIE", "a", 2},
                                         {"Empty", "", 1},
                                         {"Hos", "", 0},
                                         {"Origin", "", 0}}) {
    EXPECT_EQ(request.Field(c.name), c.value) << c.name;
    EXPECT_EQ(request.CountFields(c.name), c.count) << c.name;
  }
}

class AnswerTest : public ::testing::Test {
 protected:
  std::string Write(const std::string& name, const std::string& content) {
    const std::string path = absl::StrCat(folder_.path(), "/", name);
    std::ofstream(path, std::ios::binary) << content;
    return path;
  }

  // Sends all in steps of at most `step` bytes. Returns the bytes, or "failed" after those.
  static std::string Send(PeerAnswer answer, std::size_t step) {
    UnsentAnswer unsent(std::move(answer));
    std::string sent;
    while (true) {
      if (!unsent.Load()) {
        return sent + "failed";
      }
      const std::string next = absl::StrCat(unsent.head(), unsent.body());
      if (next.empty()) {
        return sent;
      }
      sent += next.substr(0, step);
      unsent.Consume(std::min(step, next.size()));
    }
  }

  testing::TempDir folder_;
};

TEST_F(AnswerTest, EachByteIsSentOnceInSteps) {
  const std::string long_text = std::string(2 * kPiece, 'a') + std::string(17, 'b');
  struct Case {
    int status;
    PeerFields fields;
    std::string content;
    std::string head;
  };
  const std::vector<Case> cases = {
      {200, {}, "", "HTTP/1.1 200 OK\r\n\r\n"},
      {404,
       {{"Content-Length", "3"}, {"ETag", "\"x\""}},
       "no\n",
       "HTTP/1.1 404 Not Found\r\nContent-Length: 3\r\nETag: \"x\"\r\n\r\n"},
      {431, {}, "long", "HTTP/1.1 431 Request Header Fields Too Large\r\n\r\n"},
      {200, {{"A", "b"}}, std::string(kPiece, 'c'), "HTTP/1.1 200 OK\r\nA: b\r\n\r\n"},
      {200, {}, long_text, "HTTP/1.1 200 OK\r\n\r\n"},
  };
  for (const Case& c : cases) {
    const std::string path = Write("file", c.content);
    for (const std::size_t step : {std::size_t{7}, std::size_t{1000}, kPiece, 10 * kPiece}) {
      if (c.content.size() / step > 5000) {
        continue;
      }
      EXPECT_TRUE(Send({.status = c.status, .fields = c.fields, .body = c.content}, step) ==
                  c.head + c.content)
          << c.head << " in steps of " << step;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(AnswerFile file, AnswerFile::Open(path));
      EXPECT_TRUE(Send({.status = c.status,
                        .fields = c.fields,
                        .body = "replaced by the file",
                        .file = std::move(file)},
                       step) == c.head + c.content)
          << "a file, " << c.head << " in steps of " << step;
    }
  }
}

TEST_F(AnswerTest, OneMoreWriteTakesHeadAndBodyTogether) {
  UnsentAnswer unsent({.body = "body"});
  ASSERT_TRUE(unsent.Load());
  unsent.Consume(unsent.head().size() + 1);
  EXPECT_EQ(unsent.head(), "");
  EXPECT_EQ(unsent.body(), "ody");
}

TEST_F(AnswerTest, AFileThatIsCutMeanwhileFails) {
  const std::string path = Write("file", std::string(2 * kPiece, 'a'));
  for (const auto& [left, sent] : std::vector<std::pair<std::size_t, std::size_t>>{
           {0, 0}, {10, 10}, {kPiece, kPiece}, {2 * kPiece - 1, 2 * kPiece - 1}}) {
    Write("file", std::string(2 * kPiece, 'a'));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(AnswerFile file, AnswerFile::Open(path));
    std::filesystem::resize_file(path, left);
    const std::string text = Send({.file = std::move(file)}, 10 * kPiece);
    EXPECT_EQ(text.size(),
              std::string("HTTP/1.1 200 OK\r\n\r\n").size() * (left > 0 ? 1 : 0) + sent + 6)
        << left;
    EXPECT_TRUE(text.ends_with("failed")) << left;
  }
}

TEST_F(AnswerTest, AFileThatCannotBeOpenedSaysWhy) {
  EXPECT_THAT(AnswerFile::Open(absl::StrCat(folder_.path(), "/none")),
              StatusIs(absl::StatusCode::kInternal, "No such file or directory"));
}

TEST_F(AnswerTest, AFileIsClosedOnceByItsLastOwner) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(AnswerFile first, AnswerFile::Open(Write("file", "abc")));
  EXPECT_EQ(first.size(), 3);
  AnswerFile second(std::move(first));
  EXPECT_FALSE(first.is_open());  // NOLINT(bugprone-use-after-move)
  EXPECT_TRUE(second.is_open());
  AnswerFile third;
  third = std::move(second);
  EXPECT_FALSE(second.is_open());  // NOLINT(bugprone-use-after-move)
  EXPECT_TRUE(third.is_open());
}

}  // namespace
}  // namespace isoscope::http
