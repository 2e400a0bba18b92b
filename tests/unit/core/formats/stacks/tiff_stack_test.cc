#include "core/formats/stacks/tiff_stack.h"

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/core/formats/stacks/tiff_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteTiffStack;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::string ImageJ(int channels, int slices, int frames) {
  return absl::StrCat("ImageJ=1.53\nimages=", channels * slices * frames, "\nchannels=", channels,
                      "\nslices=", slices, "\nframes=", frames, "\nhyperstack=true\n");
}

TEST(TiffStackTest, PagesThatNobodyDescribesAreSlices) {
  const TempDir dir;
  const std::string path = dir.Sub("a.tif");
  ASSERT_TRUE(WriteTiffStack(path, {.pages = 5}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const TiffStack stack, FindTiffStack({path}, "a", ""));
  EXPECT_EQ(stack.layout.slices, 5);
  EXPECT_EQ(stack.layout.channels, 1);
  EXPECT_EQ(stack.layout.steps, 1);
  EXPECT_THAT(stack.files, ElementsAre(path));
  EXPECT_FALSE(stack.raw_offset.has_value());
  EXPECT_EQ(stack.layout.PlaneOf(0, 0, 3).index, 3);
}

// The spacing was 1 in silence.
TEST(TiffStackTest, SizesOfPixelsOfGeoTiffAreReadOrNotWhole) {
  const TempDir dir;
  const std::string path = dir.Sub("a.tif");
  for (const char* mode : {"wl", "wb"}) {
    ASSERT_TRUE(WriteTiffStack(path, {.pages = 5, .model_scale = {30, 20, 5}, .mode = mode}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const TiffStack stack, FindTiffStack({path}, "a", ""));
    EXPECT_EQ(stack.layout.spacing, (math::Vec3d{30, 20, 5}));
    EXPECT_EQ(stack.layout.distances, "");
  }
  for (const std::vector<double>& scale :
       {std::vector<double>{30, 20, 0}, {30, -20, 5}, {30, 20}, {30, 20, 5, 1}}) {
    ASSERT_TRUE(WriteTiffStack(path, {.pages = 5, .model_scale = scale}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const TiffStack stack, FindTiffStack({path}, "a", ""));
    EXPECT_THAT(stack.layout.distances, HasSubstr("ModelPixelScale (33550) is 30 "));
    EXPECT_EQ(stack.layout.spacing, (math::Vec3d{1, 1, 1}));
  }
}

TEST(TiffStackTest, SlicesWithinAPageAreRefused) {
  const TempDir dir;
  const std::string path = dir.Sub("a.tif");
  ASSERT_TRUE(WriteTiffStack(path, {.pages = 1, .depth = 8}));
  EXPECT_THAT(FindTiffStack({path}, "a", "").status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("ImageDepth (32997) of 8")));
}

TEST(TiffStackTest, AxesWinOverTheHeadOfTheFile) {
  const TempDir dir;
  const std::string path = dir.Sub("a.tif");
  ASSERT_TRUE(WriteTiffStack(path, {.pages = 12, .description = ImageJ(3, 2, 2)}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const TiffStack said, FindTiffStack({path}, "a", ""));
  EXPECT_EQ(said.layout.channels, 3);
  EXPECT_EQ(said.layout.PlaneOf(1, 2, 1).index, 6 + 3 + 2);  // channels fastest, frames slowest
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const TiffStack asked, FindTiffStack({path}, "a", "CZ6"));
  EXPECT_EQ(asked.layout.channels, 2);
  EXPECT_EQ(asked.layout.slices, 6);
  EXPECT_EQ(asked.layout.steps, 1);
  EXPECT_EQ(asked.layout.PlaneOf(0, 1, 4).index, 6 + 4);
  EXPECT_THAT(FindTiffStack({path}, "a", "CZ5").status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("--axes CZ5")));
}

TEST(TiffStackTest, OneFileASliceIsInTheOrderGiven) {
  const TempDir dir;
  std::vector<std::string> files;
  for (int i = 0; i < 3; ++i) {
    files.push_back(dir.Sub(absl::StrCat("s", i, ".tif")));
    ASSERT_TRUE(WriteTiffStack(files.back(), {.pages = 1, .first = i}));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const TiffStack stack, FindTiffStack(files, "s", ""));
  EXPECT_EQ(stack.files, files);
  EXPECT_EQ(stack.layout.PlaneOf(0, 0, 2).file, 2);
  EXPECT_EQ(stack.layout.PlaneOf(0, 0, 2).index, 0);
  ASSERT_TRUE(WriteTiffStack(files[1], {.width = 5, .pages = 1}));
  EXPECT_THAT(FindTiffStack(files, "s", "").status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("s1.tif: 5 x 3")));
}

TEST(TiffStackTest, FewerPlanesThanTheHeadSaysAreRefused) {
  const TempDir dir;
  const std::string path = dir.Sub("a.tif");
  ASSERT_TRUE(WriteTiffStack(path, {.pages = 11, .description = ImageJ(3, 2, 2)}));
  EXPECT_THAT(FindTiffStack({path}, "a", "").status(),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("11 planes, but its head says 12")));
  EXPECT_THAT(FindTiffStack({}, "none", "").status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("none: no TIFF files")));
}

}  // namespace
}  // namespace isoscope::source
