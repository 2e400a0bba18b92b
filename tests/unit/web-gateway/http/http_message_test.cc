#include "web-gateway/http/http_message.h"

#include <string>

#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

#include "core/base/retry_delay.h"
#include "tests/unit/web-gateway/header_of.h"

namespace isoscope::gateway {
namespace {

TEST(HttpMessageTest, EveryCodeHasItsStatus) {
  const struct {
    absl::StatusCode code;
    int status;
  } cases[] = {
      {absl::StatusCode::kInvalidArgument, 400},   {absl::StatusCode::kOutOfRange, 400},
      {absl::StatusCode::kUnauthenticated, 401},   {absl::StatusCode::kPermissionDenied, 403},
      {absl::StatusCode::kNotFound, 404},          {absl::StatusCode::kFailedPrecondition, 409},
      {absl::StatusCode::kResourceExhausted, 429}, {absl::StatusCode::kCancelled, 499},
      {absl::StatusCode::kUnimplemented, 501},     {absl::StatusCode::kUnavailable, 503},
      {absl::StatusCode::kDeadlineExceeded, 504},  {absl::StatusCode::kInternal, 500},
      {absl::StatusCode::kDataLoss, 500},          {absl::StatusCode::kUnknown, 500},
  };
  for (const auto& c : cases) {
    EXPECT_EQ(HttpStatusOf(c.code), c.status) << absl::StatusCodeToString(c.code);
  }
}

TEST(HttpMessageTest, ErrorsAreJsonWhateverTheirMessageHas) {
  const HttpResponse response =
      ErrorResponse(absl::NotFoundError(std::string("a \"b\"\n\xff\x01 c")));
  EXPECT_EQ(response.status, 404);
  EXPECT_EQ(HeaderOf(response, "cache-control"), "no-store");
  const nlohmann::json json = nlohmann::json::parse(response.body, nullptr, false);
  ASSERT_FALSE(json.is_discarded()) << response.body;
  EXPECT_EQ(json["code"], "NOT_FOUND");
  EXPECT_EQ(json["message"].get<std::string>().substr(0, 6), "a \"b\"\n");
}

TEST(HttpMessageTest, AMissingTokenSaysHowToGiveIt) {
  EXPECT_EQ(HeaderOf(ErrorResponse(absl::UnauthenticatedError("no")), "WWW-Authenticate"),
            "Bearer");
  EXPECT_EQ(HeaderOf(ErrorResponse(absl::NotFoundError("no")), "WWW-Authenticate"), "");
}

TEST(HttpMessageTest, ARefusalThatTellsATimeHasItInHeaderAndBody) {
  const HttpResponse refused = ErrorResponse(
      base::WithRetryDelay(absl::ResourceExhaustedError("full"), absl::Milliseconds(1200)));
  EXPECT_EQ(refused.status, 429);
  EXPECT_EQ(HeaderOf(refused, "Retry-After"), "2");
  EXPECT_EQ(refused.body,
            "{\"code\":\"RESOURCE_EXHAUSTED\",\"message\":\"full\",\"retry_delay_ms\":1200}\n");
  const HttpResponse soon =
      ErrorResponse(base::WithRetryDelay(absl::UnavailableError("moving"), absl::ZeroDuration()));
  EXPECT_EQ(soon.status, 503);
  EXPECT_EQ(HeaderOf(soon, "Retry-After"), "1");
  EXPECT_EQ(HeaderOf(ErrorResponse(absl::ResourceExhaustedError("too large")), "Retry-After"), "");
}

}  // namespace
}  // namespace isoscope::gateway
