#include "web-gateway/http/access.h"

#include <cstdlib>
#include <string>
#include <tuple>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::gateway {
namespace {

using ::testing::HasSubstr;
using testing::IsOk;
using ::testing::MatchesRegex;
using testing::StatusIs;

TEST(AccessTest, OriginMustBeTheHostOrAllowed) {
  const AccessRules rules({.allowed_origins = {"https://hub.example.org"}});
  const struct {
    std::string origin;
    std::string host;
    bool is_allowed;
  } cases[] = {
      {"", "localhost:8080", true},  // no browser, or the same page
      {"http://localhost:8080", "localhost:8080", true},
      {"HTTP://LocalHost:8080", "localhost:8080", true},
      {"https://localhost:8080", "localhost:8080", true},  // behind a proxy with TLS
      {"https://hub.example.org", "localhost:8080", true},
      {"https://HUB.example.org", "127.0.0.1:8080", true},
      {"http://hub.example.org", "localhost:8080", false},
      {"http://localhost:8081", "localhost:8080", false},
      {"http://localhost", "localhost:8080", false},
      {"http://127.0.0.1:8080", "localhost:8080", false},
      {"http://evil.org", "localhost:8080", false},
      {"http://localhost:8080.evil.org", "localhost:8080", false},
      {"http://evil.org/localhost:8080", "localhost:8080", false},
      {"null", "localhost:8080", false},
      {"localhost:8080", "localhost:8080", false},
      {"file://", "", false},
      {"http://", "", false},
  };
  for (const auto& c : cases) {
    EXPECT_EQ(rules.CheckSource(c.origin, c.host).ok(), c.is_allowed) << c.origin << " " << c.host;
  }
}

TEST(AccessTest, ALoopbackGatewayTakesNoForeignNames) {
  const AccessRules rules({.allowed_origins = {"https://hub.example.org:8000"}});
  for (const char* host : {"localhost", "localhost:1", "a.localhost:1", "127.0.0.1:8080",
                           "192.168.1.2:80", "[::1]:8080", "hub.example.org"}) {
    EXPECT_THAT(rules.CheckSource("", host), IsOk()) << host;
  }
  for (const char* host :
       {"evil.org", "evil.org:8080", "localhost.evil.org", "", "1.2.3.4.evil", "127.0.0.1.evil.org",
        "1.2.3", "1.2.3.1234", "1.2.3.999", "[", "[[", "[x]", "[::1"}) {
    EXPECT_THAT(rules.CheckSource("", host),
                StatusIs(absl::StatusCode::kPermissionDenied, HasSubstr("--allow-origin")))
        << host;
  }
  // With a token a foreign page can't ask, and elsewhere the name is the operator's affair.
  EXPECT_THAT(AccessRules({.token = "t"}).CheckSource("", "evil.org"), IsOk());
  EXPECT_THAT(AccessRules({.listens_on_loopback = false}).CheckSource("", "host.org"), IsOk());
}

TEST(AccessTest, APictureInAPageOfAnotherOriginIsRefused) {
  const AccessRules rules({.token = "t", .allowed_origins = {"https://hub.example.org"}});
  const struct {
    std::string origin;
    std::string fetch_site;
    std::string referer;
    bool is_allowed;
  } cases[] = {
      {"", "", "", true},  // no browser
      {"", "none", "", true},
      {"", "same-origin", "http://localhost:8080/", true},
      {"", "cross-site", "", false},
      {"", "same-site", "", false},  // another port of this machine
      {"", "cross-site", "http://evil.org/", false},
      {"", "cross-site", "https://hub.example.org.evil.org/", false},
      {"", "cross-site", "http://hub.example.org/", false},
      {"", "cross-site", "hub.example.org", false},
      {"", "cross-site", "https://hub.example.org/a/page?q", true},
      {"", "same-site", "https://HUB.example.org", true},
      {"https://hub.example.org", "cross-site", "", true},
      {"http://evil.org", "cross-site", "https://hub.example.org/", false},
      {"http://localhost:8080", "cross-site", "", true},  // by way of another site
  };
  for (const auto& c : cases) {
    const absl::Status status = rules.CheckDataSource({.origin = c.origin,
                                                       .host = "localhost:8080",
                                                       .fetch_site = c.fetch_site,
                                                       .referer = c.referer});
    EXPECT_EQ(status.ok(), c.is_allowed) << c.origin << " " << c.fetch_site << " " << c.referer;
    if (!status.ok()) {
      EXPECT_THAT(status,
                  StatusIs(absl::StatusCode::kPermissionDenied, HasSubstr("--allow-origin")));
    }
  }
}

TEST(AccessTest, AWebSocketBringsItsTokenAsAProtocol) {
  EXPECT_EQ(TokenOfProtocols("isoscope, isoscope.bearer.YStiL2M9"), "a+b/c=");
  EXPECT_EQ(TokenOfProtocols("isoscope.bearer._-8"), "\xff\xef");
  for (const char* protocols : {"", "isoscope", "bearer.YQ", "isoscope.bearer.",
                                "isoscope.bearer.=", "isoscope.bearer.Y"}) {
    EXPECT_EQ(TokenOfProtocols(protocols), "") << protocols;
  }
  EXPECT_TRUE(OffersInteractProtocol("x,isoscope"));
  EXPECT_FALSE(OffersInteractProtocol("isoscope.bearer.YQ"));
  EXPECT_FALSE(OffersInteractProtocol(""));
}

TEST(AccessTest, TheTokenToAskForComesFromAFileOrTheEnvironment) {
  const testing::TempDir folder;
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(folder.Sub("token"), "of-the-file\n"));
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(folder.Sub("bad"), "a b"));
  const auto set = [](const char* value) { setenv("ISOSCOPE_GATEWAY_TOKEN", value, 1); };
  unsetenv("ISOSCOPE_GATEWAY_TOKEN");
  EXPECT_EQ(ReadGatewayToken("").value(), "");
  set("");
  EXPECT_EQ(ReadGatewayToken("").value(), "");
  set("of-the-variable");
  EXPECT_EQ(ReadGatewayToken("").value(), "of-the-variable");
  EXPECT_EQ(ReadGatewayToken(folder.Sub("token")).value(), "of-the-file");
  EXPECT_FALSE(ReadGatewayToken(folder.Sub("bad")).ok());
  EXPECT_FALSE(ReadGatewayToken(folder.Sub("absent")).ok());
  set("a b");
  EXPECT_THAT(ReadGatewayToken("").status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("ISOSCOPE_GATEWAY_TOKEN")));
  unsetenv("ISOSCOPE_GATEWAY_TOKEN");
}

TEST(AccessTest, TokenComesAsParameterOrAsBearer) {
  const AccessRules rules({.token = "secret"});
  EXPECT_THAT(rules.CheckToken("secret", ""), IsOk());
  EXPECT_THAT(rules.CheckToken("", "Bearer secret"), IsOk());
  EXPECT_THAT(rules.CheckToken("", "bearer  secret "), IsOk());
  for (const char* wrong : {"", "Secret", "secre", "secrets", " secret"}) {
    EXPECT_THAT(rules.CheckToken(wrong, ""), StatusIs(absl::StatusCode::kUnauthenticated)) << wrong;
  }
  for (const char* wrong : {"secret", "Basic secret", "Bearer", "Bearer ", "Bearer secret2"}) {
    EXPECT_THAT(rules.CheckToken("", wrong), StatusIs(absl::StatusCode::kUnauthenticated)) << wrong;
  }
  EXPECT_THAT(AccessRules({}).CheckToken("", ""), IsOk());
}

TEST(AccessTest, TokensAreLongAndDiffer) {
  const std::string token = MakeToken();
  EXPECT_THAT(token, MatchesRegex("[0-9a-f]{32}"));
  EXPECT_NE(token, MakeToken());
}

TEST(AccessTest, LoopbackAddresses) {
  for (const char* address : {"127.0.0.1:0", "127.1.2.3:80", "localhost:80", "[::1]:80"}) {
    EXPECT_TRUE(IsLoopback(address)) << address;
  }
  for (const char* address :
       {"0.0.0.0:80", "[::]:80", "host:80", "127.evil.org:80", "10.0.0.1:1"}) {
    EXPECT_FALSE(IsLoopback(address)) << address;
  }
}

TEST(AccessTest, OriginsOfTheOption) {
  EXPECT_EQ(ParseOrigin("https://Hub.Example.org").value(), "https://hub.example.org");
  for (const char* text :
       {"", "*", "hub", "https://", "https://hub/", "ftp://hub", "http://u@h", "https://*",
        "https://*.hub.org", "https://hub;script-src *", "https://hub'", "https://hub\r\nx"}) {
    EXPECT_THAT(ParseOrigin(text).status(),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("https://HOST")))
        << text;
  }
}

TEST(AccessTest, UsersTokensArePassedOnWhereTheGatewayHasNoneOfItsOwn) {
  const AccessRules rules({.has_user_tokens = true, .listens_on_loopback = false});
  EXPECT_TRUE(rules.asks_token());
  EXPECT_THAT(rules.CheckToken("", ""), IsOk()) << "the coordinator judges";
  for (const auto& [parameter, header, token] :
       {std::tuple("p", "", "p"), std::tuple("", "Bearer h", "h"),
        std::tuple("", "bearer  h ", "h"), std::tuple("p", "Bearer h", "p"), std::tuple("", "", ""),
        std::tuple("", "Basic h", "")}) {
    const absl::StatusOr<std::string> passed = rules.UserToken(parameter, header);
    ASSERT_THAT(passed, IsOk());
    EXPECT_EQ(*passed, token) << parameter << " " << header;
  }
  for (const char* hostile : {"a b", "a\r\nx: y", "\x7f", "\xc3\xa9"}) {
    EXPECT_THAT(rules.UserToken(hostile, ""), StatusIs(absl::StatusCode::kUnauthenticated));
  }
  const AccessRules own({.token = "t"});
  const absl::StatusOr<std::string> kept = own.UserToken("t", "");
  ASSERT_THAT(kept, IsOk());
  EXPECT_EQ(*kept, "") << "the gateway's own token is nobody else's";
}

}  // namespace
}  // namespace isoscope::gateway
