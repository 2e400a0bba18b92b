#include "server/admission/export_pace.h"

#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"

namespace isoscope::server {
namespace {

using Verdict = ExportPace::Verdict;

constexpr std::size_t kMiB = std::size_t{1} << 20;
const base::MonotonicTime kBegin = base::MonotonicTime() + absl::Hours(1);

TEST(ExportPaceTest, AChunkIn50SecondsIsTooSlowAtTheSecond) {
  ExportPace pace(ExportLimits(), kBegin);
  pace.OnWriteBegun(kBegin);
  EXPECT_EQ(pace.Judge(kBegin + absl::Seconds(49)), Verdict::kGoesOn);
  pace.OnWriteDone(kMiB, kBegin + absl::Seconds(50));
  pace.OnWriteBegun(kBegin + absl::Seconds(50));
  EXPECT_EQ(pace.Judge(kBegin + absl::Seconds(75)), Verdict::kGoesOn);
  EXPECT_EQ(pace.NextJudgement(kBegin + absl::Seconds(51)), kBegin + absl::Seconds(76));
  EXPECT_EQ(pace.Judge(kBegin + absl::Seconds(76)), Verdict::kTooSlow);
}

TEST(ExportPaceTest, AClientAtTheLeastRateGoesOnUntilTheWholeIsTooLong) {
  ExportPace pace(ExportLimits(), kBegin);
  base::MonotonicTime now = kBegin;
  while (now < kBegin + absl::Hours(2) - absl::Seconds(20)) {
    pace.OnWriteBegun(now);
    now += absl::Seconds(16);
    ASSERT_EQ(pace.Judge(now), Verdict::kGoesOn) << now - kBegin;
    pace.OnWriteDone(kMiB, now);
  }
  EXPECT_EQ(pace.NextJudgement(now), kBegin + absl::Hours(2));
  EXPECT_EQ(pace.Judge(kBegin + absl::Hours(2)), Verdict::kTooLong);
}

TEST(ExportPaceTest, TimeThatTheClientWaitsIsNotItsFaultAndSavesNothing) {
  ExportPace pace(ExportLimits(), kBegin);
  base::MonotonicTime now = kBegin + absl::Minutes(30);  // the agents were slow
  EXPECT_EQ(pace.Judge(now), Verdict::kGoesOn);
  for (int i = 0; i < 100; ++i) {
    pace.OnWriteBegun(now);
    pace.OnWriteDone(kMiB, now);
  }
  pace.OnWriteBegun(now);
  EXPECT_EQ(pace.Judge(now + absl::Seconds(59)), Verdict::kGoesOn);
  EXPECT_EQ(pace.Judge(now + absl::Seconds(60)), Verdict::kTooSlow);
}

TEST(ExportPaceTest, ADebtEndsTheNextWriteAndTheTimeOfJudgementIsAhead) {
  ExportPace pace(ExportLimits(), kBegin);
  pace.OnWriteBegun(kBegin);
  pace.OnWriteDone(1, kBegin + absl::Minutes(2));
  const base::MonotonicTime now = kBegin + absl::Minutes(2);
  EXPECT_EQ(pace.Judge(now), Verdict::kGoesOn) << "no write is under way";
  EXPECT_GT(pace.NextJudgement(now), now);
  pace.OnWriteBegun(now);
  EXPECT_EQ(pace.Judge(now), Verdict::kTooSlow);
}

}  // namespace
}  // namespace isoscope::server
