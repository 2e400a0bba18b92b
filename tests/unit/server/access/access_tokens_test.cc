#include "server/access/access_tokens.h"

#include <string>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::server {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::StatusIs;

// SHA-256 of "abc", from FIPS 180-2.
constexpr char kDigest[] = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
constexpr char kOtherDigest[] = "AA7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";

std::string File(const std::string& entries) {
  return absl::StrCat(R"({"tokens": [)", entries, "]}");
}

std::string Entry(const std::string& members) {
  return absl::StrCat(R"({"name": "a", "sha256": ")", kDigest, R"(", "datasets": ["b", "a"])",
                      members, "}");
}

TEST(AccessTokensTest, AnEntryHasItsLimits) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::vector<AccessToken> tokens,
      ParseAccessTokens(
          File(absl::StrCat(Entry(R"(, "max_viewport_px": 640, "max_frames_per_second": 0.5)"),
                            R"(, {"name": "all", "sha256": ")", kOtherDigest,
                            R"(", "datasets": ["*"]})")),
          "f"));
  ASSERT_EQ(tokens.size(), 2U);
  EXPECT_EQ(tokens[0].name, "a");
  EXPECT_EQ(tokens[0].digest, DigestOfToken("abc"));
  EXPECT_THAT(tokens[0].datasets, ElementsAre("a", "b"));
  EXPECT_FALSE(tokens[0].sees_all_datasets);
  EXPECT_EQ(tokens[0].max_viewport_px, 640);
  EXPECT_EQ(tokens[0].max_frames_per_second, 0.5);
  EXPECT_TRUE(tokens[1].sees_all_datasets);
  EXPECT_THAT(tokens[1].datasets, IsEmpty());
}

TEST(AccessTokensTest, AnEntryMayLimitWhatItsHolderHasAtATime) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::vector<AccessToken> tokens,
      ParseAccessTokens(File(Entry(R"(, "max_concurrent_frames": 1, "max_streams": 2,
                                      "max_exports": 3, "max_bytes_per_second": 1e7)")),
                        "f"));
  EXPECT_EQ(tokens.at(0).max_concurrent_frames, 1);
  EXPECT_EQ(tokens.at(0).max_streams, 2);
  EXPECT_EQ(tokens.at(0).max_exports, 3);
  EXPECT_EQ(tokens.at(0).max_bytes_per_second, 1e7);
}

TEST(AccessTokensTest, DigestsAreThoseOfThePublishedVector) {
  EXPECT_EQ(absl::BytesToHexString(DigestOfToken("abc")), kDigest);
  EXPECT_EQ(absl::BytesToHexString(DigestOfToken("")),
            "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
}

TEST(AccessTokensTest, AFileWithoutTokensLetsNobodyIn) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto tokens, ParseAccessTokens(File(""), "f"));
  EXPECT_THAT(tokens, IsEmpty());
}

TEST(AccessTokensTest, ADatasetThatIsNamedTwiceCountsOnce) {
  // Found by access_tokens_fuzz.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::vector<AccessToken> tokens,
      ParseAccessTokens(
          File(absl::StrCat(R"({"name": "a", "sha256": ")", kDigest,
                            R"(", "datasets": ["b", "a", "b"]}, {"name": "b", )", R"("sha256": ")",
                            kOtherDigest, R"(", "datasets": ["*", "*"]})")),
          "f"));
  EXPECT_THAT(tokens[0].datasets, ElementsAre("a", "b"));
  EXPECT_TRUE(tokens[1].sees_all_datasets);
}

TEST(AccessTokensTest, WhatIsWrongIsNamed) {
  struct Case {
    std::string text;
    std::string complaint;
  };
  const std::vector<Case> cases = {
      {"", "JSON object"},
      {"[]", "JSON object"},
      {"{", "JSON object"},
      {R"({"tokens": {}})", "JSON object"},
      {R"({"tokens": [], "more": 1})", "one member"},
      {File("1"), "tokens[0]: must be an object"},
      {File("{}"), "name, sha256 and datasets are required"},
      {File(R"({"name": "a", "sha256": "12", "datasets": ["a"]})"), "64 hexadecimal digits"},
      {File(R"({"name": "a", "sha256": 12, "datasets": ["a"]})"), "64 hexadecimal digits"},
      {File(R"({"name": "", "datasets": ["a"]})"), "name must be"},
      {File(R"({"name": ["a"]})"), "name must be"},
      {File(R"({"datasets": []})"), "datasets must be"},
      {File(R"({"datasets": "*"})"), "datasets must be"},
      {File(R"({"datasets": [""]})"), "datasets must be"},
      {File(R"({"datasets": [1]})"), "datasets must be"},
      {File(R"({"datasets": ["*", "a"]})"), "must stand alone"},
      {File(Entry(R"(, "max_viewport_px": 0)")), "max_viewport_px must be"},
      {File(Entry(R"(, "max_viewport_px": 1.5)")), "max_viewport_px must be"},
      {File(Entry(R"(, "max_viewport_px": 1e9)")), "max_viewport_px must be"},
      {File(Entry(R"(, "max_viewport_px": 99999999999999999999)")), "max_viewport_px must be"},
      {File(Entry(R"(, "max_frames_per_second": 0)")), "above 0"},
      {File(Entry(R"(, "max_frames_per_second": -1)")), "above 0"},
      {File(Entry(R"(, "max_frames_per_second": "1")")), "above 0"},
      {File(Entry(R"(, "max_concurrent_frames": 0)")), "max_concurrent_frames must be"},
      {File(Entry(R"(, "max_streams": 1.5)")), "max_streams must be"},
      {File(Entry(R"(, "max_exports": "1")")), "max_exports must be"},
      {File(Entry(R"(, "max_exports": 1000001)")), "from 1 to 1000000"},
      {File(Entry(R"(, "max_bytes_per_second": 0)")), "max_bytes_per_second must be"},
      {File(Entry(R"(, "max_frames": 1)")), "no member \"max_frames\""},
      {File(absl::StrCat(Entry(""), ",", Entry(""))), "tokens[1]: another entry"},
  };
  for (const Case& c : cases) {
    EXPECT_THAT(ParseAccessTokens(c.text, "/etc/tokens"),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         AllOf(HasSubstr("/etc/tokens"), HasSubstr(c.complaint))))
        << c.text;
  }
}

TEST(AccessTokensTest, AFileHasAtMostAThousandTokens) {
  std::vector<std::string> entries;
  for (std::size_t i = 0; i < kMaxAccessTokens; ++i) {
    const std::string name = absl::StrCat("user ", i);
    entries.push_back(absl::StrCat(R"({"name": ")", name, R"(", "sha256": ")",
                                   absl::BytesToHexString(DigestOfToken(name)),
                                   R"(", "datasets": ["*"]})"));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<AccessToken> tokens,
                                ParseAccessTokens(File(absl::StrJoin(entries, ",")), "f"));
  EXPECT_EQ(tokens.size(), std::size_t{1000});
  entries.push_back(entries.front());
  EXPECT_THAT(ParseAccessTokens(File(absl::StrJoin(entries, ",")), "f"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("1001 tokens")));
}

}  // namespace
}  // namespace isoscope::server
