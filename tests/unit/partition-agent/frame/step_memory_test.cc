#include "partition-agent/frame/step_memory.h"

#include <new>
#include <string>

#include "absl/status/statusor.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/error_reason.h"
#include "core/base/retry_delay.h"
#include "tests/support/memory_failure.h"
#include "tests/support/status_matchers.h"

namespace isoscope::agent {
namespace {

using isoscope::testing::IsOk;
using isoscope::testing::MemoryFailure;
using isoscope::testing::StatusIs;

TEST(StepMemoryTest, ResultsAndOtherErrorsPass) {
  EXPECT_THAT(OrNoMemoryForStep([] { return absl::OkStatus(); }), IsOk());
  EXPECT_EQ(*OrNoMemoryForStep([] { return absl::StatusOr<int>(5); }), 5);
  const absl::Status too_large = absl::ResourceExhaustedError("a viewport of 9 x 9 pixels");
  EXPECT_EQ(OrNoMemoryForStep([&] { return too_large; }), too_large);
}

// Symptom: a machine short of memory was asked for the same picture in ever smaller bands.
TEST(StepMemoryTest, AMachineShortOfMemoryIsBusyAndThePictureNotTooLarge) {
  const absl::Status error =
      OrNoMemoryForStep([]() -> absl::StatusOr<int> { throw std::bad_alloc(); }).status();
  EXPECT_THAT(error,
              StatusIs(absl::StatusCode::kResourceExhausted, "no memory for a step of the frame"));
  EXPECT_EQ(base::ReasonOf(error), base::ErrorReason::kTooBusy);
  EXPECT_GT(base::RetryDelayOf(error), absl::ZeroDuration());
}

TEST(StepMemoryTest, TheErrorItselfNeedsNoMemory) {
  for (int allocation = 1; allocation <= 6; ++allocation) {
    absl::Status error;
    {
      const MemoryFailure failure(allocation, MemoryFailure::Mode::kFromThere);
      error = NoMemoryForStep();
    }
    EXPECT_EQ(error.code(), absl::StatusCode::kResourceExhausted) << allocation;
  }
}

}  // namespace
}  // namespace isoscope::agent
