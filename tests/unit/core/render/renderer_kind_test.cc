#include "core/render/renderer_kind.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::render {
namespace {

using isoscope::testing::StatusIs;
using ::testing::_;
using ::testing::HasSubstr;

TEST(RendererKindTest, NamesAreThoseOfTheCommandLine) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(RendererKind kind, RendererKindFromName("auto"));
  EXPECT_EQ(kind, RendererKind::kAuto);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(kind, RendererKindFromName("egl"));
  EXPECT_EQ(kind, RendererKind::kEgl);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(kind, RendererKindFromName("cpu"));
  EXPECT_EQ(kind, RendererKind::kCpu);
  EXPECT_THAT(RendererKindFromName("vulkan"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("\"vulkan\"")));
  EXPECT_THAT(RendererKindFromName(""), StatusIs(absl::StatusCode::kInvalidArgument, _));
}

}  // namespace
}  // namespace isoscope::render
