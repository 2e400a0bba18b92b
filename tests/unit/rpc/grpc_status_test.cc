#include "rpc/grpc_status.h"

#include <string>

#include "absl/strings/match.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/error_reason.h"
#include "core/base/retry_delay.h"
#include "tests/support/status_matchers.h"

namespace isoscope::rpc {
namespace {

TEST(GrpcStatusTest, EveryCodeSurvivesBothWaysWithItsMessage) {
  for (int number = 1; number <= 16; ++number) {
    const absl::Status status(static_cast<absl::StatusCode>(number), "block 7 is damaged");
    const grpc::Status grpc_status = ToGrpcStatus(status);
    EXPECT_EQ(static_cast<int>(grpc_status.error_code()), number);
    EXPECT_EQ(grpc_status.error_message(), "block 7 is damaged");
    EXPECT_EQ(ToAbslStatus(grpc_status), status);
  }
}

TEST(GrpcStatusTest, TheNamesOfCodesAgreeNotOnlyTheirNumbers) {
  EXPECT_EQ(ToGrpcStatus(absl::DataLossError("")).error_code(), grpc::StatusCode::DATA_LOSS);
  EXPECT_EQ(ToGrpcStatus(absl::UnavailableError("")).error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_EQ(ToGrpcStatus(absl::InvalidArgumentError("")).error_code(),
            grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(ToGrpcStatus(absl::UnauthenticatedError("")).error_code(),
            grpc::StatusCode::UNAUTHENTICATED);
}

TEST(GrpcStatusTest, OkIsOkBothWays) {
  EXPECT_TRUE(ToGrpcStatus(absl::OkStatus()).ok());
  EXPECT_TRUE(ToAbslStatus(grpc::Status::OK).ok());
}

TEST(GrpcStatusTest, CodesThatGrpcDoesNotDefineBecomeUnknown) {
  EXPECT_THAT(ToAbslStatus(grpc::Status(static_cast<grpc::StatusCode>(20), "odd")),
              testing::StatusIs(absl::StatusCode::kUnknown, ::testing::HasSubstr("20: odd")));
}

// Symptom: a client whose TLS connection broke on a flipped bit got UNKNOWN, and did not retry.
TEST(GrpcStatusTest, ConnectionThatBrokeIsUnavailable) {
  EXPECT_THAT(
      ToAbslStatus(grpc::Status(grpc::StatusCode::UNKNOWN, "Stream removed")),
      testing::StatusIs(absl::StatusCode::kUnavailable, ::testing::HasSubstr("Stream removed")));
  EXPECT_THAT(ToAbslStatus(grpc::Status(grpc::StatusCode::UNKNOWN, "odd")),
              testing::StatusIs(absl::StatusCode::kUnknown));
}

TEST(GrpcStatusTest, MessagesTooLongForAHeaderAreCut) {
  const grpc::Status status = ToGrpcStatus(absl::InternalError(std::string(100000, 'x')));
  EXPECT_LE(status.error_message().size(), std::size_t{kMaxStatusMessageBytes});
  EXPECT_GT(status.error_message().size(), std::size_t{kMaxStatusMessageBytes - 100});
  EXPECT_THAT(status.error_message(), ::testing::EndsWith("x... (cut, 100000 bytes)"));
  const std::string whole(kMaxStatusMessageBytes, 'x');
  EXPECT_EQ(ToGrpcStatus(absl::InternalError(whole)).error_message(), whole);
}

// Symptom: a client got RESOURCE_EXHAUSTED of its own gRPC, because the header was too long.
TEST(GrpcStatusTest, BytesBeyondAsciiTakeThreeInAHeader) {
  std::string text;
  while (text.size() < 3000) {
    text += "\u00e4";
  }
  const std::string message = ToGrpcStatus(absl::InternalError(text)).error_message();
  EXPECT_LE(message.size(), std::size_t{kMaxStatusMessageBytes} / 3 + 40);
  EXPECT_THAT(message, ::testing::EndsWith("\u00e4... (cut, 3000 bytes)"));
}

// Protobuf's strings are UTF-8: Python would not read google.rpc.Status.
TEST(GrpcStatusTest, MessagesAreUtf8) {
  const grpc::Status status = ToGrpcStatus(absl::InternalError("a\xff\nb\xc3"));
  EXPECT_EQ(status.error_message(), "a?\nb?");
}

// Google's libraries encode code 8, "full" and a delay of 1.5 s as these bytes.
std::string KnownDetails() {
  using std::string_literals::operator""s;
  const std::string url = "type.googleapis.com/google.rpc.RetryInfo";
  const std::string retry_info = "\x0a\x08\x08\x01\x10\x80\xca\xb5\xee\x01"s;
  const std::string any = "\x0a\x28" + url + "\x12\x0a" + retry_info;
  return "\x08\x08\x12\x04"
         "full\x1a\x36" +
         any;
}

TEST(GrpcStatusTest, ATimeToWaitIsTheRetryInfoThatEveryoneReads) {
  const grpc::Status sent = ToGrpcStatus(
      base::WithRetryDelay(absl::ResourceExhaustedError("full"), absl::Milliseconds(1500)));
  // The details that are known stand first, for clients that look no further.
  EXPECT_TRUE(absl::StartsWith(sent.error_details(), KnownDetails()));
  EXPECT_EQ(base::RetryDelayOf(ToAbslStatus(sent)), absl::Milliseconds(1500));
}

// Google's libraries encode code 9, "no" and an ErrorInfo as these bytes.
TEST(GrpcStatusTest, AReasonIsTheErrorInfoThatEveryoneReads) {
  const std::string error_info =
      "\x0a\x12"
      "DATASET_INCOMPLETE"
      "\x12\x08"
      "isoscope"
      "\x1a\x11\x0a\x09"
      "transient"
      "\x12\x04"
      "true";
  const std::string url = "type.googleapis.com/google.rpc.ErrorInfo";
  const std::string any = "\x0a\x28" + url + "\x12\x31" + error_info;
  ASSERT_EQ(error_info.size(), 0x31u);
  ASSERT_EQ(any.size(), 0x5du);
  const grpc::Status sent = ToGrpcStatus(
      base::WithReason(absl::FailedPreconditionError("no"), base::ErrorReason::kDatasetIncomplete));
  EXPECT_EQ(sent.error_details(), "\x08\x09\x12\x02no\x1a\x5d" + any);
  EXPECT_EQ(base::ReasonOf(ToAbslStatus(sent)), base::ErrorReason::kDatasetIncomplete);
}

TEST(GrpcStatusTest, EveryReasonAndItsTimeToWaitSurviveBothWays) {
  for (int i = 0; i < base::kErrorReasonCount; ++i) {
    const auto reason = static_cast<base::ErrorReason>(i);
    const absl::Status status = base::WithReason(
        base::WithRetryDelay(absl::ResourceExhaustedError("full"), absl::Seconds(2)), reason);
    const absl::Status received = ToAbslStatus(ToGrpcStatus(status));
    EXPECT_EQ(base::ReasonOf(received), reason);
    EXPECT_EQ(base::RetryDelayOf(received), absl::Seconds(2));
  }
}

TEST(GrpcStatusTest, ReasonsOfOtherServicesAreNotOurs) {
  grpc::Status sent =
      ToGrpcStatus(base::WithReason(absl::NotFoundError("x"), base::ErrorReason::kInternal));
  std::string details = sent.error_details();
  const std::size_t domain = details.rfind("isoscope");
  ASSERT_NE(domain, std::string::npos);
  details.replace(domain, 8, "somebody");
  EXPECT_EQ(base::ReasonOf(ToAbslStatus({grpc::StatusCode::NOT_FOUND, "x", details})),
            base::ErrorReason::kDatasetUnknown);
}

TEST(GrpcStatusTest, ErrorsWithoutATimeToWaitTellNone) {
  EXPECT_EQ(base::RetryDelayOf(ToAbslStatus(ToGrpcStatus(absl::ResourceExhaustedError("large")))),
            std::nullopt);
  EXPECT_EQ(base::RetryDelayOf(ToAbslStatus({grpc::RESOURCE_EXHAUSTED, "full"})), std::nullopt);
}

TEST(GrpcStatusTest, DamagedDetailsAreLeftOutAndNeverReadBeyondTheirEnd) {
  const std::string whole = KnownDetails();
  for (std::size_t size = 0; size < whole.size(); ++size) {
    const std::string cut = whole.substr(0, size);
    EXPECT_EQ(ToAbslStatus({grpc::RESOURCE_EXHAUSTED, "full", cut}).message(), "full");
  }
  for (std::size_t i = 0; i < whole.size(); ++i) {
    for (int bit = 0; bit < 8; ++bit) {
      std::string damaged = whole;
      damaged[i] = static_cast<char>(damaged[i] ^ (1 << bit));
      const auto delay =
          base::RetryDelayOf(ToAbslStatus({grpc::RESOURCE_EXHAUSTED, "full", damaged}));
      if (delay.has_value()) {
        EXPECT_GE(*delay, absl::ZeroDuration());
        EXPECT_LE(*delay, base::kMaxRetryDelay);
      }
    }
  }
}

}  // namespace
}  // namespace isoscope::rpc
