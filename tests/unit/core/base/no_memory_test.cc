#include "core/base/no_memory.h"

#include <new>
#include <stdexcept>
#include <string>

#include "absl/status/statusor.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/memory_failure.h"
#include "tests/support/status_matchers.h"

namespace isoscope::base {
namespace {

using isoscope::testing::IsOk;
using isoscope::testing::MemoryFailure;
using isoscope::testing::StatusIs;

TEST(NoMemoryTest, ResultsPassThrough) {
  EXPECT_THAT(OrNoMemory("a picture", [] { return absl::OkStatus(); }), IsOk());
  EXPECT_THAT(OrNoMemory("a picture", [] { return absl::DataLossError("damaged"); }),
              StatusIs(absl::StatusCode::kDataLoss, "damaged"));
  EXPECT_EQ(*OrNoMemory("a picture", [] { return absl::StatusOr<int>(5); }), 5);
}

TEST(NoMemoryTest, BadAllocBecomesAStatusThatSaysWhatFor) {
  EXPECT_THAT(OrNoMemory("a picture", []() -> absl::Status { throw std::bad_alloc(); }),
              StatusIs(absl::StatusCode::kResourceExhausted, "no memory for a picture"));
  EXPECT_THAT(OrNoMemory("a picture", []() -> absl::StatusOr<int> { throw std::bad_alloc(); }),
              StatusIs(absl::StatusCode::kResourceExhausted, "no memory for a picture"));
}

TEST(NoMemoryTest, OtherExceptionsAreNotHidden) {
  EXPECT_THROW(OrNoMemory("a picture", []() -> absl::Status { throw std::logic_error("bug"); })
                   .IgnoreError(),
               std::logic_error);
}

TEST(NoMemoryTest, WithoutMemoryForAMessageThereIsNone) {
  absl::Status status;
  {
    const MemoryFailure failure(1, MemoryFailure::Mode::kFromThere);
    status = NoMemory("a picture of a size that fits into no small string");
  }
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kResourceExhausted, std::string()));
}

}  // namespace
}  // namespace isoscope::base
