#include "server/frame/agent_call.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/error_reason.h"
#include "core/base/monotonic_time.h"
#include "core/base/retry_delay.h"
#include "rpc/grpc_time.h"
#include "server/cluster/agent_failure.h"
#include "tests/support/status_matchers.h"

namespace isoscope::server {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

// What the client of a failed call reads, for every code that an agent can return.
TEST(AgentCallTest, EachCodeHasItsReasonForClients) {
  using Code = absl::StatusCode;
  using Reason = base::ErrorReason;
  struct Case {
    Code of_agent;
    Code code;
    Reason reason;
    bool is_transient;
  };
  const Case cases[] = {
      {Code::kCancelled, Code::kUnavailable, Reason::kAgentLost, true},
      {Code::kUnknown, Code::kInternal, Reason::kInternal, false},
      {Code::kInvalidArgument, Code::kInternal, Reason::kInternal, false},
      {Code::kDeadlineExceeded, Code::kDeadlineExceeded, Reason::kDeadlinePassed, true},
      {Code::kNotFound, Code::kDataLoss, Reason::kShardDamaged, false},
      {Code::kAlreadyExists, Code::kInternal, Reason::kInternal, false},
      {Code::kPermissionDenied, Code::kUnavailable, Reason::kAgentLost, true},
      {Code::kResourceExhausted, Code::kResourceExhausted, Reason::kTooLarge, false},
      {Code::kFailedPrecondition, Code::kFailedPrecondition, Reason::kNotPossible, false},
      {Code::kAborted, Code::kInternal, Reason::kInternal, false},
      {Code::kOutOfRange, Code::kInternal, Reason::kInternal, false},
      {Code::kUnimplemented, Code::kUnavailable, Reason::kAgentLost, true},
      {Code::kInternal, Code::kInternal, Reason::kInternal, false},
      {Code::kUnavailable, Code::kUnavailable, Reason::kAgentLost, true},
      {Code::kDataLoss, Code::kDataLoss, Reason::kShardDamaged, false},
      {Code::kUnauthenticated, Code::kUnavailable, Reason::kAgentLost, true},
  };
  for (const Case& c : cases) {
    const AgentFailure failure{.agent = {.address = "a:1", .shard_indices = {0}},
                               .status = CallStatus(absl::Status(c.of_agent, "x"), false)};
    const absl::Status told = failure.ToStatus();
    EXPECT_EQ(told.code(), c.code) << absl::StatusCodeToString(c.of_agent);
    EXPECT_EQ(base::ReasonOf(told), c.reason) << absl::StatusCodeToString(c.of_agent);
    EXPECT_EQ(base::IsTransient(base::ReasonOf(told)), c.is_transient);
  }
}

TEST(AgentCallTest, TheAgentsOwnReasonAndRetryDelayReachTheClient) {
  const absl::Status opening =
      base::WithReason(base::WithRetryDelay(absl::UnavailableError("x"), absl::Seconds(1)),
                       base::ErrorReason::kAgentOpening);
  const AgentFailure failure{.agent = {.address = "a:1", .shard_indices = {0}},
                             .status = CallStatus(opening, false)};
  EXPECT_EQ(base::ReasonOf(failure.ToStatus()), base::ErrorReason::kAgentOpening);
  EXPECT_EQ(base::RetryDelayOf(failure.ToStatus()), absl::Seconds(1));
}

// Symptom: a source that had vanished was SHARD_DAMAGED, and one without rights AGENT_LOST.
TEST(AgentCallTest, ErrorsOfASourceKeepTheirCodes) {
  for (const absl::StatusCode code :
       {absl::StatusCode::kNotFound, absl::StatusCode::kPermissionDenied,
        absl::StatusCode::kUnavailable}) {
    const AgentFailure failure{
        .agent = {.address = "a:1", .shard_indices = {0}},
        .status = CallStatus(
            base::WithReason(absl::Status(code, "x"), base::ErrorReason::kSourceUnreadable),
            false)};
    const absl::Status told = failure.ToStatus();
    EXPECT_THAT(told, StatusIs(code, "agent a:1 (shard 0): x"));
    EXPECT_EQ(base::ReasonOf(told), base::ErrorReason::kSourceUnreadable);
    EXPECT_TRUE(LacksParts(failure.status)) << code;
    EXPECT_FALSE(failure.IsLost()) << code;
  }
  EXPECT_FALSE(LacksParts(absl::OkStatus()));
  EXPECT_FALSE(LacksParts(absl::InternalError("x")));
}

TEST(AgentCallTest, CodesThatWouldMisleadTheClientAreReplaced) {
  struct Case {
    absl::Status ended;
    bool was_cancelled_by_us;
    absl::StatusCode code;
  };
  const Case cases[] = {
      {absl::OkStatus(), false, absl::StatusCode::kOk},
      {absl::CancelledError("x"), true, absl::StatusCode::kCancelled},
      {absl::CancelledError("x"), false, absl::StatusCode::kUnavailable},
      {absl::UnknownError("x, Stream removed"), true, absl::StatusCode::kUnavailable},
      {absl::UnknownError("x"), false, absl::StatusCode::kInternal},
      {absl::UnimplementedError("x"), false, absl::StatusCode::kUnavailable},
      {absl::InvalidArgumentError("x"), false, absl::StatusCode::kInternal},
      {absl::DataLossError("x"), false, absl::StatusCode::kDataLoss},
  };
  for (const Case& c : cases) {
    EXPECT_THAT(CallStatus(c.ended, c.was_cancelled_by_us),
                StatusIs(c.code, HasSubstr(c.ended.ok() ? "" : "x")))
        << c.ended << c.was_cancelled_by_us;
  }
}

TEST(AgentCallTest, ACallWithoutDeadlineHasNone) {
  grpc::ClientContext endless;
  SetDeadline(base::MonotonicTime::InfiniteFuture(), &endless);
  EXPECT_EQ(rpc::FromGrpcTime(endless.raw_deadline()), base::MonotonicTime::InfiniteFuture());
  const base::MonotonicTime deadline = base::MonotonicNow() + absl::Hours(1000);
  grpc::ClientContext limited;
  SetDeadline(deadline, &limited);
  const base::MonotonicTime read = rpc::FromGrpcTime(limited.raw_deadline());
  EXPECT_LE(absl::AbsDuration(read - deadline), absl::Hours(1));
}

}  // namespace
}  // namespace isoscope::server
