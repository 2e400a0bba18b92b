#include "core/render/renderer_factory.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::render {
namespace {

using isoscope::testing::StatusIs;
using ::testing::_;
using ::testing::HasSubstr;

TEST(RendererFactoryTest, NamesAreThoseOfTheCommandLine) {
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

TEST(RendererFactoryTest, EglIsMadeWhenAskedFor) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto renderer, MakeRenderer({.kind = RendererKind::kEgl}));
  EXPECT_THAT(renderer->description(), HasSubstr("egl"));
}

TEST(RendererFactoryTest, AutoFindsARenderer) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto renderer, MakeRenderer({}));
  EXPECT_FALSE(renderer->description().empty());
}

}  // namespace
}  // namespace isoscope::render
