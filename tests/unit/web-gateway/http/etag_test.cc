#include "web-gateway/http/etag.h"

#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::gateway {
namespace {

using ::testing::MatchesRegex;

TEST(EtagTest, DependsOnEveryPartAndOnWhereItEnds) {
  EXPECT_THAT(MakeEtag({"a"}), MatchesRegex("\"[0-9a-f]{32}\""));
  EXPECT_EQ(MakeEtag({"a", "b"}), MakeEtag({"a", "b"}));
  EXPECT_NE(MakeEtag({"a", "b"}), MakeEtag({"ab", ""}));
  EXPECT_NE(MakeEtag({"a", "b"}), MakeEtag({"b", "a"}));
  EXPECT_NE(MakeEtag({""}), MakeEtag({}));
}

TEST(EtagTest, IfNoneMatchIsAList) {
  const std::string etag = MakeEtag({"a"});
  for (const std::string& header :
       {etag, "W/" + etag, "\"x\", " + etag, etag + " ,\"y\"", std::string("*"), "  " + etag}) {
    EXPECT_TRUE(MatchesEtag(header, etag)) << header;
  }
  for (const std::string& header :
       {std::string(), std::string("\"x\""), etag.substr(1), std::string(","), std::string("W/")}) {
    EXPECT_FALSE(MatchesEtag(header, etag)) << header;
  }
}

}  // namespace
}  // namespace isoscope::gateway
