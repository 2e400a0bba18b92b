#include "core/rpc/grpc_status.h"

#include <string>

#include "gtest/gtest.h"

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

// Symptom: a client whose TLS connection broke on a flipped bit got UNKNOWN, and did not try again.
TEST(GrpcStatusTest, ConnectionThatBrokeIsUnavailable) {
  EXPECT_THAT(
      ToAbslStatus(grpc::Status(grpc::StatusCode::UNKNOWN, "Stream removed")),
      testing::StatusIs(absl::StatusCode::kUnavailable, ::testing::HasSubstr("Stream removed")));
  EXPECT_THAT(ToAbslStatus(grpc::Status(grpc::StatusCode::UNKNOWN, "odd")),
              testing::StatusIs(absl::StatusCode::kUnknown));
}

TEST(GrpcStatusTest, MessagesTooLongForAHeaderAreCut) {
  const grpc::Status status = ToGrpcStatus(absl::InternalError(std::string(100000, 'x')));
  EXPECT_EQ(status.error_message().size(), std::size_t{kMaxStatusMessageBytes});
  EXPECT_THAT(status.error_message(), ::testing::EndsWith("..."));
}

}  // namespace
}  // namespace isoscope::rpc
