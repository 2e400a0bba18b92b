#include "client-cli/output/plane_flags.h"

#include "gtest/gtest.h"

#include "core/cli/usage.h"
#include "tests/support/status_matchers.h"

namespace isoscope::cli {
namespace {

namespace v1 = isoscope::v1;

TEST(PlaneFlagsTest, TheSuffixChoosesJpeg) {
  for (const char* path : {"a.jpg", "b/A.JPEG", "a.png.jpg"}) {
    EXPECT_TRUE(IsJpegName(path)) << path;
  }
  for (const char* path : {"a.png", "jpg", "a.jpg.png", "a"}) {
    EXPECT_FALSE(IsJpegName(path)) << path;
  }
}

TEST(PlaneFlagsTest, FlagsBecomeOptionsOfTheRequest) {
  const v1::OutputOptions plain = MakeOutputOptions({}, "a.png");
  EXPECT_EQ(plain.ByteSizeLong(), 0U) << "an unchanged request must stay as it was";
  const v1::OutputOptions jpeg = MakeOutputOptions({.jpeg_quality = 40}, "a.jpg");
  EXPECT_EQ(jpeg.image_format(), v1::OutputOptions::IMAGE_FORMAT_JPEG);
  EXPECT_EQ(jpeg.jpeg_quality(), 40);
  const v1::OutputOptions planes =
      MakeOutputOptions({.files = {.depth = "d.npy", .position = "p.npy"}}, std::nullopt);
  EXPECT_EQ(planes.image_format(), v1::OutputOptions::IMAGE_FORMAT_NONE);
  EXPECT_TRUE(planes.depth());
  EXPECT_TRUE(planes.position());
  EXPECT_FALSE(planes.normal());
  EXPECT_FALSE(planes.surface_index());
  EXPECT_FALSE(planes.depth_bounds());
  const v1::OutputOptions bounds =
      MakeOutputOptions({.files = {.depth_bounds = "b.npy"}}, std::nullopt);
  EXPECT_EQ(bounds.image_format(), v1::OutputOptions::IMAGE_FORMAT_NONE);
  EXPECT_TRUE(bounds.depth_bounds());
}

TEST(PlaneFlagsTest, QualityIsForJpegOnly) {
  ISOSCOPE_EXPECT_OK(CheckUsage(PlaneFlags{.jpeg_quality = 40}, "a.jpg"));
  EXPECT_TRUE(IsUsageError(CheckUsage(PlaneFlags{.jpeg_quality = 40}, "a.png")));
  EXPECT_TRUE(IsUsageError(CheckUsage(PlaneFlags{.jpeg_quality = 40}, std::nullopt)));
}

}  // namespace
}  // namespace isoscope::cli
