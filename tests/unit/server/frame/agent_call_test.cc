#include "server/frame/agent_call.h"

#include <chrono>

#include "absl/time/clock.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::server {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

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
      {absl::UnknownError("x"), false, absl::StatusCode::kUnknown},
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
  SetDeadline(absl::InfiniteFuture(), &endless);
  EXPECT_EQ(endless.deadline(), std::chrono::system_clock::time_point::max());
  const absl::Time deadline = absl::UnixEpoch() + absl::Hours(1'000'000);
  grpc::ClientContext limited;
  SetDeadline(deadline, &limited);
  EXPECT_EQ(absl::FromChrono(limited.deadline()), deadline);
}

}  // namespace
}  // namespace isoscope::server
