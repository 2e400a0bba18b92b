#include "core/formats/zarr/zarr_volumes.h"

#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/substitute.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/unit/core/formats/zarr/zarr_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::NumberText;
using ::isoscope::testing::Objects;
using ::isoscope::testing::OpenObjects;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::Zarr2Text;
using ::isoscope::testing::Zarr3Group;
using ::isoscope::testing::Zarr3Text;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

absl::StatusOr<ZarrVolumes> Find(const Objects& objects, const ZarrChoice& choice = {}) {
  auto store = OpenObjects(objects);
  return store.ok() ? FindZarrVolumes(store->get(), choice) : store.status();
}

std::vector<std::string> Names(const ZarrVolumes& volumes) {
  std::vector<std::string> names;
  for (const SourceField& field : volumes.info.fields) {
    names.push_back(field.name);
  }
  return names;
}

// Two variables of (time, z, y, x), one of a vector, one of another grid, as xarray writes them.
Objects Xarray() {
  const auto dims = [](const std::string& names, const std::string& more = "") {
    return absl::StrCat("{\"_ARRAY_DIMENSIONS\": ", names, more, "}");
  };
  return {
      {".zgroup", "{\"zarr_format\": 2}"},
      {"t/.zarray", Zarr2Text({2, 3, 4, 5}, {1, 3, 4, 5}, "<f4")},
      {"t/.zattrs", dims(R"(["time", "z", "y", "x"])", R"(, "units": "K", "long_name": "heat")")},
      {"u/.zarray", Zarr2Text({2, 3, 4, 5, 3}, {1, 3, 4, 5, 3}, "<f4")},
      {"u/.zattrs", dims(R"(["time", "z", "y", "x", "component"])")},
      {"other/.zarray", Zarr2Text({3, 4, 6}, {3, 4, 6}, "<f4")},
      {"other/.zattrs", dims(R"(["z", "y", "x2"])")},
      {"flat/.zarray", Zarr2Text({4, 5}, {4, 5}, "<f4")},
      {"flat/.zattrs", dims(R"(["y", "x"])")},
      {"time/.zarray", Zarr2Text({2}, {2}, "<i8")},
      {"time/.zattrs", dims(R"(["time"])", R"(, "units": "days since 2000-01-01")")},
      {"time/0", NumberText<std::int64_t>({3, 5})},
      {"z/.zarray", Zarr2Text({3}, {3}, "<f8")},
      {"z/.zattrs", dims(R"(["z"])", R"(, "units": "m")")},
      {"z/0", NumberText<double>({10, 12, 14})},
      {"y/.zarray", Zarr2Text({4}, {4}, "<f8")},
      {"y/.zattrs", dims(R"(["y"])", R"(, "units": "m")")},
      {"y/0", NumberText<double>({4, 3, 2, 1})},
      {"x/.zarray", Zarr2Text({5}, {5}, "<f8")},
      {"x/.zattrs", dims(R"(["x"])", R"(, "units": "m")")},
      {"x/0", NumberText<double>({0, 1, 2, 3, 4})}};
}

TEST(ZarrVolumesTest, FindsTheArraysOfAGroup) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrVolumes volumes, Find(Xarray()));
  EXPECT_THAT(Names(volumes), ElementsAre("t", "u"));
  EXPECT_EQ(volumes.info.fields[0].unit, "K");
  EXPECT_EQ(volumes.info.fields[0].long_name, "heat");
  EXPECT_THAT(volumes.info.fields[1].components, ElementsAre("x", "y", "z"));
  EXPECT_THAT(volumes.info.fields_elsewhere, ElementsAre("other"));
  EXPECT_THAT(volumes.info.times, ElementsAre(3, 5));
  EXPECT_EQ(volumes.info.time_unit, "days since 2000-01-01");
  EXPECT_EQ(volumes.info.length_unit, "m");
  ISOSCOPE_ASSERT_OK(volumes.geometry);
  EXPECT_EQ(volumes.geometry->spacing, (math::Vec3d{1, 1, 2}));
  EXPECT_EQ(volumes.geometry->origin, (math::Vec3d{0, 4, 10}));
  EXPECT_EQ(volumes.geometry->direction.columns[1], (math::Vec3d{0, -1, 0}));
  EXPECT_THAT(volumes.arrays, ElementsAre("time", "z", "y", "x", "t", "u"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrVolumes other, Find(Xarray(), {.path = "other"}));
  EXPECT_THAT(Names(other), ElementsAre("other"));
  EXPECT_THAT(Find(Xarray(), {.path = "flat"}), StatusIs(kInvalid, HasSubstr("2 axes")));
}

TEST(ZarrVolumesTest, KeepsErrorsOfTheGridForWhoeverOpensAVolume) {
  Objects objects = Xarray();
  objects["x/0"] = NumberText<double>({0, 1, 2, 3, 7});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrVolumes uneven, Find(objects));
  EXPECT_THAT(uneven.geometry, StatusIs(kInvalid, HasSubstr("axis \"x\" is not even")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrVolumes resampled,
                                Find(objects, {.rules = {.resamples = true}}));
  ISOSCOPE_EXPECT_OK(resampled.geometry);
  EXPECT_THAT(resampled.distances[0], ElementsAre(0, 1, 2, 3, 7));
  objects = Xarray();
  objects["time/0"] = NumberText<std::int64_t>({5, 3});
  EXPECT_THAT(Find(objects), StatusIs(kInvalid));
  objects["time/.zarray"] = Zarr2Text({2}, {2}, "<M8[Y]");
  EXPECT_THAT(Find(objects), StatusIs(kInvalid, HasSubstr("years and months")));
}

TEST(ZarrVolumesTest, TakesArraysThatSayNothing) {
  const Objects three = {{"zarr.json", Zarr3Text({4, 5, 6}, {4, 5, 6}, "uint8")}};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrVolumes volumes, Find(three));
  EXPECT_THAT(Names(volumes), ElementsAre("memory"));
  EXPECT_EQ(volumes.geometry->sample_dims, (math::Index3{6, 5, 4}));
  const Objects five = {{"zarr.json", Zarr3Text({2, 3, 4, 5, 6}, {1, 1, 4, 5, 6}, "uint8")}};
  EXPECT_THAT(Find(five), StatusIs(kInvalid, HasSubstr("--axes ")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrVolumes letters, Find(five, {.axes = "TCZYX"}));
  EXPECT_EQ(letters.info.times.size(), 2U);
  EXPECT_EQ(letters.info.fields[0].components.size(), 3U);
  EXPECT_THAT(Find(five, {.axes = "ZYX"}), StatusIs(kInvalid));
  EXPECT_THAT(Find({{"zarr.json", Zarr3Text({4, 5}, {4, 5}, "uint8")}}), StatusIs(kInvalid));
}

TEST(ZarrVolumesTest, FindsTheOnlyVolumeBelow) {
  Objects objects = {{"zarr.json", Zarr3Group()},
                     {"a/zarr.json", Zarr3Group()},
                     {"a/b/zarr.json", Zarr3Text({4, 5, 6}, {4, 5, 6}, "uint8")},
                     {"a/table/zarr.json", Zarr3Text({4}, {4}, "uint8")}};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrVolumes volumes, Find(objects));
  EXPECT_THAT(Names(volumes), ElementsAre("b"));
  objects["c/zarr.json"] = Zarr3Group();
  EXPECT_TRUE(Find(objects).ok());
  objects["c/d/zarr.json"] = objects["a/b/zarr.json"];
  EXPECT_THAT(Find(objects), StatusIs(kInvalid, AllOf(HasSubstr("2 volumes"), HasSubstr("a/b, c/d"),
                                                      HasSubstr("memory:a/b"))));
  EXPECT_THAT(Find({{"zarr.json", Zarr3Group()}}), StatusIs(kInvalid, HasSubstr(":PATH")));
  EXPECT_THAT(Find(objects, {.path = "none"}), StatusIs(absl::StatusCode::kNotFound));
}

// An image of two levels, two channels and three times, with label images.
Objects Ome(bool is_v3) {
  const std::string image = R"("multiscales": [{"version": "0.4", "axes": [
      {"name": "t", "type": "time", "unit": "second"}, {"name": "c", "type": "channel"},
      {"name": "z", "type": "space", "unit": "micrometer"},
      {"name": "y", "type": "space", "unit": "micrometer"},
      {"name": "x", "type": "space", "unit": "micrometer"}], "datasets": [
      {"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [2, 1, 3, 1, 1]}]},
      {"path": "1", "coordinateTransformations": [{"type": "scale", "scale": [2, 1, 6, 2, 2]}]}]}],
      "omero": {"channels": [{"label": "DAPI"}, {"label": "GFP"}]})";
  const std::string labels = R"("multiscales": [{"version": "0.4", "axes": ["z", "y", "x"],
      "datasets": [{"path": "0"}]}], "image-label": {})";
  if (is_v3) {
    return {{"zarr.json", Zarr3Group(absl::StrCat("{\"ome\": {", image, "}}"))},
            {"0/zarr.json", Zarr3Text({3, 2, 4, 6, 8}, {1, 1, 4, 6, 8}, "uint16")},
            {"1/zarr.json", Zarr3Text({3, 2, 2, 3, 4}, {1, 1, 2, 3, 4}, "uint16")},
            {"labels/zarr.json", Zarr3Group(R"({"ome": {"labels": ["cells"]}})")},
            {"labels/cells/zarr.json", Zarr3Group(absl::StrCat("{\"ome\": {", labels, "}}"))},
            {"labels/cells/0/zarr.json", Zarr3Text({4, 6, 8}, {4, 6, 8}, "uint32")}};
  }
  const std::string group = "{\"zarr_format\": 2}";
  return {{".zgroup", group},
          {".zattrs", absl::StrCat("{", image, "}")},
          {"0/.zarray", Zarr2Text({3, 2, 4, 6, 8}, {1, 1, 4, 6, 8}, "<u2")},
          {"1/.zarray", Zarr2Text({3, 2, 2, 3, 4}, {1, 1, 2, 3, 4}, "<u2")},
          {"labels/.zgroup", group},
          {"labels/.zattrs", R"({"labels": ["cells"]})"},
          {"labels/cells/.zgroup", group},
          {"labels/cells/.zattrs", absl::StrCat("{", labels, "}")},
          {"labels/cells/0/.zarray", Zarr2Text({4, 6, 8}, {4, 6, 8}, "<u4")}};
}

TEST(ZarrVolumesTest, ReadsOmeZarr) {
  for (const bool is_v3 : {false, true}) {
    const Objects objects = Ome(is_v3);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrVolumes image, Find(objects));
    EXPECT_THAT(Names(image), ElementsAre("DAPI", "GFP"));
    EXPECT_THAT(image.info.times, ElementsAre(0, 2, 4));
    EXPECT_EQ(image.info.time_unit, "second");
    EXPECT_EQ(image.info.length_unit, "micrometer");
    EXPECT_THAT(image.info.fields_elsewhere, ElementsAre("1", "labels/cells"));
    EXPECT_EQ(image.geometry->spacing, (math::Vec3d{1, 1, 3}));
    EXPECT_THAT(image.fields[1].part.index, ElementsAre(0, 1, 0, 0, 0));
    EXPECT_THAT(image.arrays, ElementsAre("0"));
    EXPECT_EQ(image.note, "");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrVolumes level, Find(objects, {.path = "1"}));
    EXPECT_EQ(level.geometry->sample_dims, (math::Index3{4, 3, 2}));
    EXPECT_EQ(level.geometry->spacing, (math::Vec3d{2, 2, 6}));
    EXPECT_THAT(level.note, HasSubstr("level 1 begins at 0 along z"));
    EXPECT_THAT(level.info.fields_elsewhere, ElementsAre("0", "labels/cells"));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrVolumes labels,
                                  Find(objects, {.path = "labels/cells"}));
    EXPECT_THAT(Names(labels), ElementsAre("cells"));
    EXPECT_THAT(labels.info.times, IsEmpty());
    // --axes takes the arrays for what they are.
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrVolumes plain,
                                  Find(objects, {.path = "0", .axes = "TCZYX"}));
    EXPECT_EQ(plain.geometry->spacing, (math::Vec3d{1, 1, 1}));
    EXPECT_EQ(plain.info.fields[0].components.size(), 2U);
  }
}

TEST(ZarrVolumesTest, ChoosesAnImageOfSeveral) {
  const auto image = [](const char* path, int scale) {
    return absl::Substitute(
        R"({"axes": ["z", "y", "x"], "datasets": [{"path": "$0", "coordinateTransformations":
            [{"type": "scale", "scale": [$1, $1, $1]}]}]})",
        path, scale);
  };
  Objects objects = {
      {"zarr.json", Zarr3Group(absl::StrCat(R"({"ome": {"version": "0.5", "multiscales": [)",
                                            image("a", 2), ", ", image("b", 3), "]}}"))},
      {"a/zarr.json", Zarr3Text({4, 6, 8}, {4, 6, 8}, "uint16")},
      {"b/zarr.json", Zarr3Text({2, 3, 4}, {2, 3, 4}, "uint16")},
      {"c/zarr.json", Zarr3Text({2, 3, 4}, {2, 3, 4}, "uint16")}};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrVolumes first, Find(objects));
  EXPECT_THAT(first.info.fields_elsewhere, ElementsAre("b"));
  EXPECT_EQ(first.geometry->spacing, (math::Vec3d{2, 2, 2}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrVolumes second, Find(objects, {.path = "b"}));
  EXPECT_THAT(second.info.fields_elsewhere, ElementsAre("a"));
  EXPECT_EQ(second.geometry->spacing, (math::Vec3d{3, 3, 3}));
  EXPECT_EQ(second.geometry->sample_dims, (math::Index3{4, 3, 2}));
  // A level of an image that can't be read is no plain array.
  objects["zarr.json"] = Zarr3Group(absl::StrCat(R"({"ome": {"version": "0.5", "multiscales": [)",
                                                 image("a", 2), R"(, {"datasets": []}]}})"));
  EXPECT_THAT(Find(objects, {.path = "b"}), StatusIs(kInvalid, HasSubstr("list of datasets")));
  ISOSCOPE_EXPECT_OK(Find(objects));
}

TEST(ZarrVolumesTest, FindsLabels) {
  Objects objects = Ome(true);
  const std::string plain = objects["labels/cells/zarr.json"];
  objects["labels/cells/zarr.json"] =
      absl::StrReplaceAll(plain, {{R"("image-label": {})", R"("image-label": {"properties":
                                      [{"label-value": 3, "name": "nucleus"}]})"}});
  ASSERT_NE(objects["labels/cells/zarr.json"], plain);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto store, OpenObjects(objects));
  for (const char* path : {"labels/cells", "labels/cells/0"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto labels, FindZarrLabels(store.get(), path));
    EXPECT_THAT(labels, ElementsAre(volume::Label{.value = 3, .name = "nucleus"}));
  }
  for (const char* path : {"", "0", "labels"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto labels, FindZarrLabels(store.get(), path));
    EXPECT_THAT(labels, IsEmpty());
  }
  EXPECT_THAT(FindZarrLabels(store.get(), "none"), StatusIs(absl::StatusCode::kNotFound));
}

// An array of times alone is no volume, and beside others a coordinate.
TEST(ZarrVolumesTest, TakesTimesOfNumpy) {
  Objects objects = Xarray();
  objects["time/.zarray"] = Zarr2Text({2}, {2}, "<M8[h]");
  objects["time/.zattrs"] = R"({"_ARRAY_DIMENSIONS": ["time"]})";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrVolumes volumes, Find(objects));
  EXPECT_THAT(volumes.info.times, ElementsAre(3, 5));
  EXPECT_EQ(volumes.info.time_unit, "hours since 1970-01-01");
  EXPECT_THAT(Find({{".zarray", Zarr2Text({2, 3, 4}, {2, 3, 4}, "<m8[s]")}}),
              StatusIs(kInvalid, HasSubstr("an array of times")));
}

TEST(ZarrVolumesTest, GoesToTheFirstImageOfACollection) {
  Objects objects = {{"zarr.json", Zarr3Group(R"({"ome": {"bioformats2raw.layout": 3}})")}};
  for (const char* number : {"0", "1"}) {
    for (const auto& [key, bytes] : Ome(true)) {
      objects[absl::StrCat(number, "/", key)] = bytes;
    }
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrVolumes image, Find(objects));
  EXPECT_THAT(image.info.fields_elsewhere, ElementsAre("0/1", "0/labels/cells", "1"));
  EXPECT_THAT(image.arrays, ElementsAre("0/0"));
  EXPECT_THAT(
      Find({{"zarr.json", Zarr3Group(R"({"ome": {"plate": {"wells": [{"path": "A/1"}]}}})")}}),
      StatusIs(kInvalid, HasSubstr("A/1/0")));
}

TEST(ZarrVolumesTest, RefusesImagesThatAreNoVolumes) {
  Objects objects = Ome(true);
  objects["0/zarr.json"] = Zarr3Text({3, 2, 4, 6}, {1, 1, 4, 6}, "uint16");
  EXPECT_THAT(Find(objects), StatusIs(kInvalid, HasSubstr("t, c, z, y, x")));
  objects = Ome(true);
  objects.erase("0/zarr.json");
  EXPECT_THAT(Find(objects), StatusIs(absl::StatusCode::kNotFound));
  objects["0/zarr.json"] = Zarr3Text({3, 2, 4, 6, 8}, {1, 1, 4, 6, 8}, "complex64");
  EXPECT_THAT(Find(objects), StatusIs(kInvalid, HasSubstr("complex64")));
  objects["0/zarr.json"] = Zarr3Text({300'000, 2, 4, 6, 8}, {1, 1, 4, 6, 8}, "uint8");
  EXPECT_THAT(Find(objects), StatusIs(kInvalid, HasSubstr("300000 steps")));
  objects["0/zarr.json"] = Zarr3Text({3, 2, 1, 6, 8}, {1, 1, 1, 6, 8}, "uint8");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrVolumes plane, Find(objects));
  EXPECT_THAT(plane.geometry, StatusIs(kInvalid));
}

}  // namespace
}  // namespace isoscope::source
