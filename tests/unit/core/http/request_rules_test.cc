// Sections: RFC 9110 (semantics), RFC 9112 (HTTP/1.1), RFC 6455 (WebSockets).

#include "core/http/request_rules.h"

#include <optional>
#include <string>

#include "absl/strings/ascii.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::http {
namespace {

using ::testing::HasSubstr;

PeerRequest RequestOf(const PeerFields& fields, const std::string& target = "/") {
  PeerRequest request{.method = "GET", .target = target, .fields = {{"Host", "here:80"}}};
  request.fields.insert(request.fields.end(), fields.begin(), fields.end());
  return request;
}

// 0: it may be answered.
int StatusOf(const PeerRequest& request) {
  const std::optional<Refusal> refusal = CheckRequest(request);
  return refusal.has_value() ? refusal->status : 0;
}

TEST(RequestRulesTest, AFieldThatARequestHasOnceMayNotComeTwice) {
  for (const char* name :
       {"Host", "Authorization", "Content-Length", "Content-Type", "Origin", "Referer",
        "Sec-Fetch-Site", "Sec-WebSocket-Key", "Sec-WebSocket-Version"}) {
    PeerRequest request = RequestOf({});
    request.fields.emplace_back(name, "x");
    EXPECT_EQ(StatusOf(request), std::string(name) == "Host" ? 400 : 0) << name;
    request.fields.emplace_back(absl::AsciiStrToLower(name), "x");
    const std::optional<Refusal> refusal = CheckRequest(request);
    ASSERT_TRUE(refusal.has_value()) << name;
    EXPECT_EQ(refusal->status, 400);
    EXPECT_THAT(refusal->reason, HasSubstr(name));
  }
  // Lists may come in parts (9110, 5.3).
  EXPECT_EQ(StatusOf(RequestOf({{"Accept", "a"},
                                {"Accept", "b"},
                                {"If-None-Match", "\"1\""},
                                {"If-None-Match", "\"2\""},
                                {"Cookie", "a"},
                                {"Cookie", "b"}})),
            0);
}

TEST(RequestRulesTest, AHostIsNamedOnce) {
  PeerRequest request{.method = "GET", .target = "/"};
  EXPECT_EQ(StatusOf(request), 400) << "9112, 3.2: HTTP/1.1 without Host";
  request.is_http_1_0 = true;
  EXPECT_EQ(StatusOf(request), 0);
  for (const char* host :
       {"here", "here:80", "192.0.2.7:8080", "[::1]:8080", "[::1]", "a_b.c-d", "here:"}) {
    request.fields = {{"Host", host}};
    EXPECT_EQ(StatusOf(request), 0) << host;
  }
  for (const char* host : {"", ":80", "here:x", "here/there", "user@here", "a b", "a,b", "::1",
                           "here?x", "here#x", "http://here", "h\x80"}) {
    request.fields = {{"Host", host}};
    EXPECT_EQ(StatusOf(request), 400) << host;
  }
}

TEST(RequestRulesTest, AnAddressIsAPathOrHasSchemeAndHost) {
  for (const char* target :
       {"/", "/v1?x=1", "http://there/v1", "HTTPS://there", "http://there?x"}) {
    EXPECT_EQ(StatusOf(RequestOf({}, target)), 0) << target;
  }
  for (const char* target : {"", "*", "v1", "there:80", "ftp://there/", "http://", "http:///v1",
                             "http://user@there/", "?x=1"}) {
    EXPECT_EQ(StatusOf(RequestOf({}, target)), 400) << target;
  }
  PeerRequest options = RequestOf({}, "*");
  options.method = "OPTIONS";
  EXPECT_EQ(StatusOf(options), 0) << "9112, 3.2.4";
}

TEST(RequestRulesTest, TheHostOfTheAddressCountsBeforeTheField) {
  EXPECT_EQ(HostOf(RequestOf({}, "/v1")), "here:80");
  EXPECT_EQ(HostOf(RequestOf({}, "http://there:8080/v1?x=http://a/")), "there:8080");
  EXPECT_EQ(HostOf(RequestOf({}, "http://there?x=1")), "there");
  EXPECT_EQ(HostOf(RequestOf({}, "/v1?x=http://a/")), "here:80");
  EXPECT_EQ(WithoutHost("http://there:8080/v1?x=1"), "/v1?x=1");
  EXPECT_EQ(WithoutHost("HTTPS://there"), "/");
  EXPECT_EQ(WithoutHost("http://there?x=1"), "/?x=1");
  EXPECT_EQ(WithoutHost("/v1?x=http://a/b"), "/v1?x=http://a/b");
  EXPECT_EQ(WithoutHost("*"), "*");
}

TEST(RequestRulesTest, OnlyChunkedBodiesAreRead) {
  EXPECT_EQ(StatusOf(RequestOf({{"Transfer-Encoding", "Chunked"}})), 0);
  EXPECT_EQ(StatusOf(RequestOf({{"Transfer-Encoding", "gzip, chunked"}})), 501) << "9112, 6.1";
  EXPECT_EQ(StatusOf(RequestOf({{"Transfer-Encoding", "gzip"}, {"Transfer-Encoding", "chunked"}})),
            501);
  PeerRequest old = RequestOf({{"Transfer-Encoding", "chunked"}});
  old.is_http_1_0 = true;
  EXPECT_EQ(StatusOf(old), 400);
  PeerRequest socket = RequestOf({});
  socket.asks_websocket = true;
  EXPECT_EQ(StatusOf(socket), 0);
  socket.has_body = true;
  EXPECT_EQ(StatusOf(socket), 400);
}

TEST(RequestRulesTest, OtherExpectationsThan100ContinueFail) {
  EXPECT_EQ(StatusOf(RequestOf({{"Expect", "100-Continue"}})), 0);
  EXPECT_EQ(StatusOf(RequestOf({{"Expect", ""}})), 0);
  EXPECT_EQ(StatusOf(RequestOf({{"Expect", "100-continue"}, {"Expect", "tea"}})), 417);
  EXPECT_EQ(StatusOf(RequestOf({{"Expect", "tea=1, 100-continue"}})), 417) << "9110, 10.1.1";
  EXPECT_THAT(CheckRequest(RequestOf({{"Expect", "tea"}}))->reason, HasSubstr("'tea'"));
}

TEST(RequestRulesTest, AClientWaitsToContinueIfItHasABody) {
  PeerRequest request = RequestOf({{"Expect", "100-CONTINUE"}});
  EXPECT_FALSE(WaitsToContinue(request));
  request.has_body = true;
  EXPECT_TRUE(WaitsToContinue(request));
  request.is_http_1_0 = true;
  EXPECT_FALSE(WaitsToContinue(request)) << "9110, 10.1.1: it is ignored";
  PeerRequest silent = RequestOf({});
  silent.has_body = true;
  EXPECT_FALSE(WaitsToContinue(silent));
}

TEST(RequestRulesTest, ReasonsBoundWhatTheyRepeat) {
  const std::string long_text(16'000, 'x');
  for (const PeerRequest& request :
       {RequestOf({{"Expect", long_text}}), RequestOf({{"Transfer-Encoding", long_text}}),
        RequestOf({}, long_text)}) {
    EXPECT_LT(CheckRequest(request)->reason.size(), 400U);
  }
}

}  // namespace
}  // namespace isoscope::http
