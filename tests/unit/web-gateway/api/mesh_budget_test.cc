#include "web-gateway/api/mesh_budget.h"

#include <memory>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/retry_delay.h"
#include "tests/support/status_matchers.h"

namespace isoscope::gateway {
namespace {

using ::testing::HasSubstr;
using testing::IsOk;
using testing::StatusIs;
using LeaseOr = absl::StatusOr<std::shared_ptr<MeshBudget::Lease>>;

TEST(MeshBudgetTest, ACallerHasFewMeshesAndOthersTheirOwn) {
  MeshBudget budget(/*max_per_caller=*/2, /*max_bytes=*/100);
  LeaseOr first = budget.Begin("a");
  const LeaseOr second = budget.Begin("a");
  EXPECT_THAT(first, IsOk());
  EXPECT_THAT(second, IsOk());
  for (int i = 0; i < 2; ++i) {
    const LeaseOr refused = budget.Begin("a");
    EXPECT_THAT(refused.status(),
                StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("--max-caller-meshes")));
    EXPECT_TRUE(base::RetryDelayOf(refused.status()).has_value());
  }
  EXPECT_THAT(budget.Begin("b"), IsOk());
  first = absl::CancelledError();
  EXPECT_THAT(budget.Begin("a"), IsOk());
}

TEST(MeshBudgetTest, AllMeshesTogetherStayBelowTheDiskSpace) {
  MeshBudget budget(/*max_per_caller=*/2, /*max_bytes=*/100);
  const LeaseOr large = budget.Begin("a");
  LeaseOr small = budget.Begin("b");
  ISOSCOPE_ASSERT_OK(large);
  ISOSCOPE_ASSERT_OK(small);
  EXPECT_THAT((*large)->SetBytes(60), IsOk());
  EXPECT_THAT((*small)->SetBytes(40), IsOk());
  const absl::Status full = (*large)->SetBytes(61);
  EXPECT_THAT(full, StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("--max-mesh-bytes")));
  EXPECT_TRUE(base::RetryDelayOf(full).has_value());
  EXPECT_THAT((*small)->SetBytes(30), IsOk());
  EXPECT_THAT((*large)->SetBytes(70), IsOk());
  small = absl::CancelledError();
  EXPECT_THAT((*large)->SetBytes(100), IsOk());
  EXPECT_THAT((*large)->SetBytes(101), StatusIs(absl::StatusCode::kResourceExhausted));
}

}  // namespace
}  // namespace isoscope::gateway
