#include "core/render/renderer_factory.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/render/egl_renderer.h"
#include "tests/support/status_matchers.h"

namespace isoscope::render {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

TEST(RendererFactoryTest, EglIsMadeWhenAskedFor) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto renderer, MakeRenderer({.kind = RendererKind::kEgl}));
  EXPECT_THAT(renderer->description(), HasSubstr("egl"));
}

TEST(RendererFactoryTest, AutoTakesOpenGlOnlyWhereAGpuDraws) {
  // OpenGL only where a GPU draws: our own rasterizer is faster than one of Mesa's.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto egl, EglRenderer::Make({}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto renderer, MakeRenderer({}));
  EXPECT_THAT(renderer->description(), StartsWith(egl->is_hardware() ? "egl: " : "cpu: "));
  EXPECT_EQ(renderer->picture_revision().back_end,
            egl->is_hardware() ? frame::BackEnd::kEgl : frame::BackEnd::kCpu);
}

TEST(RendererFactoryTest, CpuIsMadeWhenAskedFor) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto renderer, MakeRenderer({.kind = RendererKind::kCpu}));
  EXPECT_THAT(renderer->description(), StartsWith("cpu: "));
}

}  // namespace
}  // namespace isoscope::render
