#include "core/render/renderer_factory.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::render {
namespace {

using ::testing::HasSubstr;

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
