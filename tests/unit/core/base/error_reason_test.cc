#include "core/base/error_reason.h"

#include <set>
#include <string>

#include "absl/strings/ascii.h"
#include "absl/strings/cord.h"
#include "gtest/gtest.h"

#include "core/base/retry_delay.h"

namespace isoscope::base {
namespace {

TEST(ErrorReasonTest, EveryReasonHasANameOfItsOwnInUpperSnakeCase) {
  std::set<std::string> names;
  for (int i = 0; i < kErrorReasonCount; ++i) {
    const auto reason = static_cast<ErrorReason>(i);
    const std::string name = NameOf(reason);
    EXPECT_TRUE(names.insert(name).second) << name;
    EXPECT_EQ(ErrorReasonFromName(name), reason);
    for (const char c : name) {
      EXPECT_TRUE(absl::ascii_isupper(static_cast<unsigned char>(c)) || c == '_') << name;
    }
  }
  EXPECT_EQ(ErrorReasonFromName("NO_SUCH_REASON"), std::nullopt);
  EXPECT_EQ(ErrorReasonFromName(""), std::nullopt);
}

TEST(ErrorReasonTest, AReasonThatWasSetCountsForMoreThanTheCode) {
  const absl::Status status =
      WithReason(absl::FailedPreconditionError("shard 3"), ErrorReason::kDatasetIncomplete);
  EXPECT_EQ(ReasonOf(status), ErrorReason::kDatasetIncomplete);
  EXPECT_EQ(status.message(), "shard 3");
  EXPECT_TRUE(absl::IsFailedPrecondition(status));
}

TEST(ErrorReasonTest, APrefixKeepsReasonAndRetryDelay) {
  const absl::Status status = WithPrefix(
      "block 7: ", WithReason(WithRetryDelay(absl::UnavailableError("503"), absl::Seconds(3)),
                              ErrorReason::kSourceUnreadable));
  EXPECT_TRUE(absl::IsUnavailable(status));
  EXPECT_EQ(status.message(), "block 7: 503");
  EXPECT_EQ(ReasonOf(status), ErrorReason::kSourceUnreadable);
  EXPECT_EQ(RetryDelayOf(status), absl::Seconds(3));
}

TEST(ErrorReasonTest, ErrorsWithoutOneHaveThatOfTheirCode) {
  EXPECT_EQ(ReasonOf(absl::NotFoundError("")), ErrorReason::kDatasetUnknown);
  EXPECT_EQ(ReasonOf(absl::InvalidArgumentError("")), ErrorReason::kInvalidField);
  EXPECT_EQ(ReasonOf(absl::UnavailableError("")), ErrorReason::kAgentLost);
  EXPECT_EQ(ReasonOf(absl::DataLossError("")), ErrorReason::kShardDamaged);
  EXPECT_EQ(ReasonOf(absl::FailedPreconditionError("")), ErrorReason::kNotPossible);
  EXPECT_EQ(ReasonOf(absl::AbortedError("")), ErrorReason::kInternal);
}

TEST(ErrorReasonTest, OnlyARefusalThatTellsATimeIsBusyWithoutItIsFinal) {
  const absl::Status refused = absl::ResourceExhaustedError("");
  EXPECT_EQ(ReasonOf(refused), ErrorReason::kTooLarge);
  EXPECT_FALSE(IsTransient(ReasonOf(refused)));
  const absl::Status busy = WithRetryDelay(refused, absl::Seconds(1));
  EXPECT_EQ(ReasonOf(busy), ErrorReason::kTooBusy);
  EXPECT_TRUE(IsTransient(ReasonOf(busy)));
}

TEST(ErrorReasonTest, APayloadThatIsNoReasonIsNone) {
  absl::Status status = absl::NotFoundError("");
  status.SetPayload("isoscope.reason", absl::Cord("OF_A_NEWER_SERVER"));
  EXPECT_EQ(ReasonOf(status), ErrorReason::kDatasetUnknown);
}

}  // namespace
}  // namespace isoscope::base
