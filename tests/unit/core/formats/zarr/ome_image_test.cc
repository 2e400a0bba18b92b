#include "core/formats/zarr/ome_image.h"

#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

const char* const kImage = R"({"multiscales": [{"version": "0.4", "name": "scan",
    "axes": [{"name": "t", "type": "time", "unit": "second"}, {"name": "c", "type": "channel"},
             {"name": "z", "type": "space", "unit": "micrometer"},
             {"name": "y", "type": "space", "unit": "micrometer"},
             {"name": "x", "type": "space", "unit": "micrometer"}],
    "datasets": [
      {"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [1, 1, 2, 0.5, 0.5]}]},
      {"path": "1", "coordinateTransformations": [{"type": "scale", "scale": [1, 1, 4, 1, 1]},
         {"type": "translation", "translation": [0, 0, 1, 0.25, 0.25]}]}],
    "coordinateTransformations": [{"type": "scale", "scale": [10, 1, 1, 1, 1]},
         {"type": "translation", "translation": [5, 0, 100, 0, 0]}]}],
    "omero": {"channels": [{"label": "DAPI"}, {"label": "GFP"}]}})";

OmeImage Image(const std::string& text) {
  auto image = OmeImageIn(ZarrJson::parse(text), "f.zarr");
  return image.ok() && image->has_value() ? **image : OmeImage();
}

TEST(OmeImageTest, ReadsAxesLevelsAndChannels) {
  const OmeImage image = Image(kImage);
  EXPECT_EQ(image.name, "scan");
  EXPECT_EQ(DescribeOmeAxes(image.axes), "t, c, z, y, x");
  ASSERT_EQ(image.levels.size(), 2U);
  EXPECT_THAT(image.levels[0].scale, ElementsAre(10, 1, 2, 0.5, 0.5));
  EXPECT_THAT(image.levels[1].scale, ElementsAre(10, 1, 4, 1, 1));
  EXPECT_THAT(image.levels[1].translation, ElementsAre(5, 0, 101, 0.25, 0.25));
  EXPECT_THAT(image.channels, ElementsAre("DAPI", "GFP"));
  const auto space = OmeSpaceOf(image.axes);
  ASSERT_TRUE(space.has_value());
  EXPECT_THAT(*space, ElementsAre(2, 3, 4));
  // Version 0.5 has the same below "ome".
  const OmeImage newer = Image(absl::StrCat("{\"ome\": ", kImage, "}"));
  EXPECT_EQ(newer.levels.size(), 2U);
  // Axes are names in 0.3, and fixed before.
  const OmeImage names = Image(R"({"multiscales": [{"version": "0.3", "axes": ["z", "y", "x"],
                                   "datasets": [{"path": "s0"}]}]})");
  EXPECT_EQ(DescribeOmeAxes(names.axes), "z, y, x");
  EXPECT_THAT(names.levels[0].scale, ElementsAre(1, 1, 1));
  EXPECT_EQ(Image(R"({"multiscales": [{"datasets": [{"path": "0"}]}]})").axes.size(), 5U);
  const auto none = OmeImageIn(ZarrJson::parse("{\"a\": 1}"), "f");
  EXPECT_TRUE(none.ok() && !none->has_value());
}

// zarr-conventions/multiscales, of geospatial stores, has an object in the place of the list. Taken for
// an image, it would hide the arrays of its group.
TEST(OmeImageTest, AnotherConventionOfTheNameIsNoImage) {
  const auto none = OmeImageIn(
      ZarrJson::parse(R"({"multiscales": {"layout": [{"asset": "level0"}]}})"), "f.zarr");
  ISOSCOPE_ASSERT_OK(none);
  EXPECT_FALSE(none->has_value());
}

TEST(OmeImageTest, MakesTheGrid) {
  const OmeImage image = Image(kImage);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const OmeGrid grid, OmeGridOf(image, 1, {3, 2, 4, 8, 16}, {}));
  EXPECT_EQ(grid.unit, "micrometer");
  EXPECT_EQ(grid.geometry.sample_dims, (math::Index3{16, 8, 4}));
  EXPECT_EQ(grid.geometry.spacing, (math::Vec3d{1, 1, 4}));
  EXPECT_EQ(grid.geometry.origin, (math::Vec3d{0.25, 0.25, 101}));
  // Level 1 lies where means of 2 x 2 x 2 samples do: half a sample of level 0 further.
  EXPECT_EQ(OmeLevelNote(image, 1, {3, 2, 8, 16, 32}, {3, 2, 4, 8, 16}), "");
  EXPECT_EQ(OmeLevelNote(image, 1, {3, 2, 7, 16, 32}, {3, 2, 4, 8, 16}), "");
}

TEST(OmeImageTest, NotesLevelsThatLieElsewhere) {
  OmeImage image = Image(kImage);
  image.levels[1].translation = image.levels[0].translation;
  EXPECT_THAT(
      OmeLevelNote(image, 1, {3, 2, 8, 16, 32}, {3, 2, 4, 8, 16}),
      HasSubstr("level 1 begins at 100 along z in the file, and means of 2 samples of level "
                "0 at 101"));
  image.levels[1] = image.levels[0];
  EXPECT_THAT(OmeLevelNote(image, 1, {3, 2, 8, 16, 32}, {3, 2, 4, 8, 16}),
              HasSubstr("level 1 has 4 of 8 samples along z, and distances 1 times"));
}

TEST(OmeImageTest, TurnsAxesThatGoBackwardsOrStandInAnotherOrder) {
  const OmeImage image = Image(R"({"multiscales": [{"axes": [
      {"name": "x", "type": "space", "unit": "millimeter"},
      {"name": "y", "type": "space", "unit": "micrometer"},
      {"name": "z", "type": "space", "unit": "millimeter"}],
      "datasets": [{"path": "0", "coordinateTransformations":
        [{"type": "scale", "scale": [2, -3000, 4]},
         {"type": "translation", "translation": [1, 2000, 3]}]}]}]})");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const OmeGrid grid, OmeGridOf(image, 0, {5, 6, 7}, {}));
  EXPECT_EQ(grid.unit, "m");  // they have several
  EXPECT_EQ(grid.geometry.sample_dims, (math::Index3{7, 6, 5}));
  EXPECT_NEAR(grid.geometry.spacing.x, 0.004, 1e-15);
  EXPECT_NEAR(grid.geometry.spacing.y, 0.003, 1e-15);
  EXPECT_EQ(grid.geometry.direction.columns[0], (math::Vec3d{0, 0, 1}));
  EXPECT_EQ(grid.geometry.direction.columns[1], (math::Vec3d{0, -1, 0}));
  EXPECT_EQ(grid.geometry.direction.columns[2], (math::Vec3d{1, 0, 0}));
  EXPECT_NEAR(grid.geometry.origin.y, 0.002, 1e-15);
  EXPECT_NEAR(grid.geometry.origin.z, 0.003, 1e-15);
}

TEST(OmeImageTest, RefusesDistancesThatMakeNoSense) {
  OmeImage image = Image(kImage);
  image.levels[0].scale[3] = 0;
  EXPECT_THAT(OmeGridOf(image, 0, {3, 2, 4, 8, 16}, {}),
              StatusIs(kInvalid, HasSubstr("scale of axis y is 0")));
  ISOSCOPE_EXPECT_OK(OmeGridOf(image, 0, {3, 2, 4, 8, 16}, {.has_spacing = true}));
  image = Image(kImage);
  image.axes[2].unit = "";
  EXPECT_THAT(OmeGridOf(image, 0, {3, 2, 4, 8, 16}, {}), StatusIs(kInvalid, HasSubstr("axis z")));
  image = Image(kImage);
  EXPECT_THAT(OmeGridOf(image, 0, {3, 2, 1, 8, 16}, {}), StatusIs(kInvalid));  // a plane
}

TEST(OmeImageTest, RefusesAttributesThatMakeNoSense) {
  for (const char* bad :
       {R"({"multiscales": []})", R"({"multiscales": 3})", R"({"multiscales": [3]})",
        R"({"multiscales": [{"version": "0.6", "datasets": [{"path": "0"}]}]})",
        R"({"multiscales": [{"version": 5, "datasets": [{"path": "0"}]}]})",
        R"({"multiscales": [{"datasets": []}]})", R"({"multiscales": [{"datasets": [{}]}]})",
        R"({"multiscales": [{"axes": ["x", "x"], "datasets": [{"path": "0"}]}]})",
        R"({"multiscales": [{"axes": ["q"], "datasets": [{"path": "0"}]}]})",
        R"({"multiscales": [{"axes": [], "datasets": [{"path": "0"}]}]})",
        R"({"multiscales": [{"axes": ["y", "x"], "datasets": [{"path": "0",
            "coordinateTransformations": [{"type": "affine"}]}]}]})",
        R"({"multiscales": [{"axes": ["y", "x"], "datasets": [{"path": "0",
            "coordinateTransformations": [{"type": "scale", "scale": [1]}]}]}]})",
        R"({"multiscales": [{"axes": ["y", "x"], "datasets": [{"path": "0",
            "coordinateTransformations": [{"type": "scale", "path": "a"}]}]}]})"}) {
    EXPECT_THAT(OmeImageIn(ZarrJson::parse(bad), "f.zarr"),
                StatusIs(kInvalid, HasSubstr("f.zarr: OME-Zarr: ")))
        << bad;
  }
}

TEST(OmeImageTest, ReadsSeveralImages) {
  const ZarrJson attributes = ZarrJson::parse(R"({"multiscales": [
      {"axes": ["z", "y", "x"], "datasets": [{"path": "a"}]},
      {"axes": ["z", "q", "x"], "datasets": [{"path": "bad"}]},
      {"axes": ["z", "y", "x"], "datasets": [{"path": "b/0"}, {"path": "b/1"}]}]})");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const OmeImages found, OmeImagesIn(attributes, "f.zarr"));
  ASSERT_EQ(found.images.size(), 2U);
  EXPECT_EQ(found.images[1].levels[1].path, "b/1");
  EXPECT_THAT(found.others, StatusIs(kInvalid, HasSubstr("f.zarr: OME-Zarr: an axis")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto first, OmeImageIn(attributes, "f.zarr"));
  EXPECT_EQ(first->levels[0].path, "a");
}

TEST(OmeImageTest, ReadsNamesAndColoursOfLabels) {
  const std::string table = R"({"image-label": {"version": "0.4",
      "colors": [{"label-value": 5, "rgba": [1, 2, 255, 0]}, {"label-value": 1, "rgba": [9, 9, 9]},
                 {"label-value": 7}, {"label-value": 8, "rgba": [300, 0, 0, 0]}],
      "properties": [{"label-value": 1, "area": 12, "name": " left lung "},
                     {"label-value": 2, "class": "tumour", "note": "x"},
                     {"label-value": 3, "cell type": "T cell", "area": 3},
                     {"label-value": 4, "a": "x", "b": "y"}]}})";
  for (const std::string& text : {table, absl::StrCat("{\"ome\": ", table, "}")}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto labels, OmeLabelTableIn(ZarrJson::parse(text)));
    EXPECT_THAT(
        labels,
        ElementsAre(volume::Label{.value = 1,
                                  .name = "left lung",
                                  .color = volume::LabelColor{.red = 9, .green = 9, .blue = 9}},
                    volume::Label{.value = 2, .name = "tumour"},
                    volume::Label{.value = 3, .name = "T cell"},
                    volume::Label{.value = 5,
                                  .color = volume::LabelColor{.red = 1, .green = 2, .blue = 255}}));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto none, OmeLabelTableIn(ZarrJson::parse("{}")));
  EXPECT_TRUE(none.empty());
  for (const char* bad :
       {R"({"image-label": {"colors": 3}})", R"({"image-label": {"colors": [3]}})",
        R"({"image-label": {"properties": [{"name": "a"}]}})",
        R"({"image-label": {"colors": [{"label-value": NULL}]}})",
        R"({"image-label": {"colors": [{"label-value": "NaN"}]}})"}) {
    const ZarrJson json = ZarrJson::parse(absl::StrReplaceAll(bad, {{"NULL", "null"}}));
    EXPECT_THAT(OmeLabelTableIn(json), StatusIs(kInvalid, HasSubstr("image-label"))) << bad;
  }
}

TEST(OmeImageTest, KnowsCollections) {
  EXPECT_THAT(OmeLabelsIn(ZarrJson::parse(R"({"labels": ["cells", 3]})")), ElementsAre("cells"));
  EXPECT_THAT(OmeLabelsIn(ZarrJson::parse(R"({"ome": {"labels": ["cells"]}})")),
              ElementsAre("cells"));
  EXPECT_THAT(OmeCollectionIn(ZarrJson::parse(R"({"plate": {"wells": [{"path": "A/1"}]}})")),
              HasSubstr("\"A/1/0\""));
  EXPECT_THAT(OmeCollectionIn(ZarrJson::parse(R"({"well": {"images": [{"path": "0"}]}})")),
              HasSubstr("a well of 1"));
  EXPECT_EQ(OmeCollectionIn(ZarrJson::parse("{}")), "");
}

}  // namespace
}  // namespace isoscope::source
