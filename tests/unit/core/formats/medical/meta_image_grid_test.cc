#include "core/formats/medical/meta_image_grid.h"

#include <string>
#include <tuple>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/source/volume_source.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

class MetaImageGridTest : public ::testing::Test {
 protected:
  std::string Write(const std::string& lines, const std::string& dims = "4 3 2", int axes = 3) {
    testing::WriteFile(
        dir_.Sub("a.mha"),
        absl::StrCat("ObjectType = Image\nNDims = ", axes, "\n", lines, "DimSize = ", dims,
                     "\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n", std::string(24, 'x')));
    return dir_.Sub("a.mha");
  }
  absl::StatusOr<volume::GridGeometry> Read(const std::string& lines) {
    return ReadMetaImageGrid(Write(lines), {});
  }
  testing::TempDir dir_;
};

math::Vec3d At(const volume::GridGeometry& grid, const math::Vec3d& index) {
  return math::TransformPoint(grid.world_from_index(), index);
}

TEST_F(MetaImageGridTest, EveryFieldHasItsOtherNames) {
  for (const char* origin : {"Offset", "Position", "Origin"}) {
    for (const char* matrix : {"TransformMatrix", "Rotation", "Orientation"}) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto grid,
                                    Read(absl::StrCat(matrix, " = 0 1 0 -1 0 0 0 0 1\n", origin,
                                                      " = 10 20 30\nElementSpacing = 1.5 2 3\n")));
      EXPECT_EQ(At(grid, {1, 0, 0}), (math::Vec3d{10, 21.5, 30}));
      EXPECT_EQ(At(grid, {0, 1, 0}), (math::Vec3d{8, 20, 30}));
      EXPECT_EQ(At(grid, {0, 0, 1}), (math::Vec3d{10, 20, 33}));
    }
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto grid, Read("ElementSize = 1.5 2 3\n"));
  EXPECT_EQ(grid.spacing, (math::Vec3d{1.5, 2, 3}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(grid, Read("ElementSize = 1 1 1\nElementSpacing = 1.5 2 3\n"));
  EXPECT_EQ(grid.spacing, (math::Vec3d{1.5, 2, 3}));  // voxels may be thinner than their distance
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(grid, Read(""));
  EXPECT_EQ(grid.spacing, (math::Vec3d{1, 1, 1}));
  EXPECT_EQ(grid.origin, (math::Vec3d{0, 0, 0}));
}

TEST_F(MetaImageGridTest, DistancesAreAboveZero) {
  for (const char* name : {"ElementSpacing", "ElementSize"}) {
    for (const char* bad : {"1 0 3", "1 -2 3"}) {
      const std::string path = Write(absl::StrCat(name, " = ", bad, "\n"));
      EXPECT_THAT(OpenVolumeFile(path),
                  StatusIs(kInvalid, AllOf(HasSubstr(absl::StrCat("number 2 of ", name)),
                                           HasSubstr("--spacing X,Y,Z"))))
          << bad;
      EXPECT_TRUE(OpenVolumeFile(path, "", {.has_spacing = true}).ok()) << bad;
    }
    for (const char* bad : {"1 nan 3", "1 inf 3"}) {
      const std::string path = Write(absl::StrCat(name, " = ", bad, "\n"));
      EXPECT_THAT(OpenVolumeFile(path),
                  StatusIs(kInvalid, AllOf(HasSubstr(name), HasSubstr("--spacing X,Y,Z"))));
      EXPECT_TRUE(OpenVolumeFile(path, "", {.has_spacing = true}).ok()) << bad;
    }
    EXPECT_THAT(Read(absl::StrCat(name, " = 1 2\n")),
                StatusIs(kInvalid, HasSubstr("expected 3 numbers")));
  }
}

TEST_F(MetaImageGridTest, FieldsThatAreNoneOrContradictEachOtherAreRefused) {
  for (const char* lines :
       {"Offset = 1 2\n", "Offset = 1 2 x\n", "Offset = nan 0 0\n", "TransformMatrix = 1 0 0\n",
        "TransformMatrix = 1 0 0 0 1 0 0 0 inf\n", "TransformMatrix = 1 0 0 1 0 0 0 0 1\n",
        "Offset = 1 2 3\nOrigin = 1 2 4\n",
        "TransformMatrix = 1 0 0 0 1 0 0 0 1\nRotation = 0 1 0 1 0 0 0 0 1\n"}) {
    EXPECT_THAT(Read(lines), StatusIs(kInvalid, HasSubstr("a.mha"))) << lines;
  }
  EXPECT_TRUE(Read("Offset = 1 2 3\nPosition = 1 2 3\n").ok());
}

// The last one counted.
TEST_F(MetaImageGridTest, AFieldIsThereOnce) {
  for (const char* name : {"ElementSpacing", "Offset", "Position", "elementspacing"}) {
    EXPECT_THAT(Read(absl::StrCat(name, " = 1 1 1\n", name, " = 2 2 2\n")),
                StatusIs(kInvalid, AllOf(HasSubstr(name), HasSubstr("2 2 2"), HasSubstr("1 1 1"))));
  }
  EXPECT_TRUE(Read("Comment = a\nComment = b\nOffset = 1 1 1\nOffset = 1 1 1\n").ok());
}

TEST_F(MetaImageGridTest, ByteOrdersThatDifferAreRefused) {
  for (const auto& [order, other, is_good] :
       {std::tuple{"True", "True", true}, std::tuple{"False", "False", true},
        std::tuple{"False", "True", false}, std::tuple{"True", "False", false}}) {
    const std::string path = Write(
        absl::StrCat("BinaryDataByteOrderMSB = ", order, "\nElementByteOrderMSB = ", other, "\n"));
    if (is_good) {
      ISOSCOPE_EXPECT_OK(OpenVolumeFile(path).status());
    } else {
      EXPECT_THAT(OpenVolumeFile(path), StatusIs(kInvalid, HasSubstr("one byte order")));
    }
  }
}

TEST_F(MetaImageGridTest, WhatIsNoVolumeIsNamed) {
  EXPECT_THAT(OpenVolumeFile(Write("", "4 3 2 1 2", 5)),
              StatusIs(kInvalid, AllOf(HasSubstr("5-dimensional, 4 x 3 x 2 x 1 x 2 samples"),
                                       HasSubstr("extract one"))));
  EXPECT_THAT(OpenVolumeFile(Write("ElementNumberOfChannels = 2\n", "4 3 2 2", 4)),
              StatusIs(kInvalid, HasSubstr("4-dimensional")));
  ISOSCOPE_EXPECT_OK(OpenVolumeFile(Write("", "4 3 2 1 1", 5)).status());
  EXPECT_THAT(OpenVolumeFile(Write("", "4 3 1", 3)), StatusIs(kInvalid, HasSubstr("4 x 3 x 1")));
  EXPECT_THAT(OpenVolumeFile(Write("ElementNumberOfChannels = 0\n")),
              StatusIs(kInvalid, HasSubstr("ElementNumberOfChannels = 0")));
}

TEST_F(MetaImageGridTest, AFourthAxisIsLeftOut) {
  const std::string spacing = "ElementSpacing = 1.5 2 3 9\nOffset = 1 2 3 4\n";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto grid,
      ReadMetaImageGrid(
          Write(absl::StrCat(spacing, "TransformMatrix = 1 0 0 0 0 1 0 0 0 0 -1 0 0 0 0 1\n"),
                "4 3 2 1", 4),
          {}));
  EXPECT_EQ(At(grid, {1, 1, 1}), (math::Vec3d{2.5, 4, 0}));
  EXPECT_THAT(ReadMetaImageGrid(
                  Write("TransformMatrix = 1 0 0 1 0 1 0 0 0 0 1 0 0 0 0 1\n", "4 3 2 1", 4), {}),
              StatusIs(kInvalid, HasSubstr("axis 4")));
  EXPECT_THAT(ReadMetaImageGrid(Write("", "4 3 2", 4), {}),
              StatusIs(kInvalid, HasSubstr("NDims = 4")));
}

}  // namespace
}  // namespace isoscope::source
