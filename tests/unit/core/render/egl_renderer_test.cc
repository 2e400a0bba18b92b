#include "core/render/egl_renderer.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::render {
namespace {

// The contract that both back ends keep is tested in renderer_test.cc.

TEST(EglRendererTest, DescriptionNamesBackEndAndDriver) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto renderer, EglRenderer::Make({}));
  EXPECT_THAT(renderer->description(), ::testing::HasSubstr("egl: "));
  EXPECT_THAT(renderer->description(), ::testing::HasSubstr("OpenGL "));
}

}  // namespace
}  // namespace isoscope::render
