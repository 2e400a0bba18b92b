#include "client-cli/output/surface_measures.h"

#include <algorithm>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::cli {
namespace {

using ::testing::HasSubstr;
using Json = nlohmann::ordered_json;

MeasuredSurface Closed() {
  MeasuredSurface surface;
  surface.surface.set_isovalue(100000);
  surface.measures = {.area = 12.5, .volume = 3.0625, .triangle_count = 1234};
  return surface;
}

MeasuredSurface Open() {
  MeasuredSurface surface;
  surface.surface.add_labels(3);
  surface.surface.add_labels(4000000);
  surface.measures = {.area = 0.1, .triangle_count = 7, .open_edge_count = 12};
  return surface;
}

TEST(SurfaceMeasuresTest, ALineTellsAreaAndVolumeOrHowOpenItIs) {
  EXPECT_EQ(DescribeMeasures(Closed(), "mm"),
            "isovalue 100000: area 12.5 mm^2, volume 3.0625 mm^3");
  EXPECT_EQ(DescribeMeasures(Open(), ""), "labels 3,4000000: area 0.1, open at 12 edges");
  MeasuredSurface named = Open();
  named.name = "left\nlung";
  named.measures.open_edge_count = 1;
  EXPECT_EQ(DescribeMeasures(named, "m\n"), "left lung: area 0.1 m ^2, open at 1 edge");
  named.name.clear();
  named.surface.mutable_labels()->Truncate(1);
  EXPECT_THAT(DescribeMeasures(named, ""), HasSubstr("label 3: "));
}

TEST(SurfaceMeasuresTest, JsonHasAllDigitsAndNullWhereThereIsNoVolume) {
  MeasuredSurface named = Open();
  named.name = "lung";
  named.measures.area = 1.0 / 3;
  EXPECT_EQ(MeasuresToJson({Closed(), named}, "mm"), Json::parse(R"({
    "length_unit": "mm",
    "surfaces": [
      {"isovalue": 100000.0, "area": 12.5, "volume": 3.0625, "is_closed": true,
       "open_edge_count": 0, "triangle_count": 1234},
      {"labels": [3.0, 4000000.0], "name": "lung", "area": 0.3333333333333333, "volume": null,
       "is_closed": false, "open_edge_count": 12, "triangle_count": 7}]})"));
  EXPECT_EQ(MeasuresToJson({}, ""), Json::parse(R"({"length_unit": null, "surfaces": []})"));
}

TEST(SurfaceMeasuresTest, ATableHasARowForEachSurface) {
  const std::string table = MeasuresTable({Closed(), Open()}, "mm");
  EXPECT_THAT(table, HasSubstr("area mm^2"));
  EXPECT_THAT(table, HasSubstr("volume mm^3"));
  EXPECT_THAT(table, HasSubstr("isovalue 100000"));
  EXPECT_THAT(table, HasSubstr("open at 12 edges"));
  EXPECT_THAT(table, HasSubstr("1,234"));
  EXPECT_THAT(MeasuresTable(std::vector<MeasuredSurface>(101, Closed()), ""),
              HasSubstr("... and 1 more"));
}

TEST(SurfaceMeasuresTest, SurfacesAreThoseOfTheRequestAndNamesThoseOfTheLast) {
  isoscope::v1::ExportIsosurfaceRequest request;
  request.set_isovalue(5);
  const client::SurfaceMeasures one{.area = 1};
  const std::vector<MeasuredSurface> single = MeasuredSurfaces(request, {}, {one});
  ASSERT_EQ(single.size(), 1U);
  EXPECT_EQ(single[0].surface.isovalue(), 5);
  request.clear_isovalue();
  request.add_surfaces()->set_isovalue(7);
  request.add_surfaces()->add_labels(2);
  const std::vector<MeasuredSurface> two = MeasuredSurfaces(request, {"lung"}, {one, {.area = 2}});
  ASSERT_EQ(two.size(), 2U);
  EXPECT_EQ(two[0].surface.isovalue(), 7);
  EXPECT_EQ(two[0].name, "");
  EXPECT_EQ(two[1].name, "lung");
  EXPECT_EQ(two[1].surface.labels(0), 2);
  EXPECT_EQ(two[1].measures.area, 2);
}

TEST(SurfaceMeasuresTest, LevelsHaveARowAndAnObjectEachWithWhatAFrameCosts) {
  MeasuredSurface surface = Closed();
  EXPECT_FALSE(MeasuresToJson({surface}, "").at("surfaces").at(0).contains("levels"));
  EXPECT_EQ(LevelCostsTable({surface, Open()}), "") << "no table of titles alone";
  surface.levels = {{.level = 0,
                     .max_spacing_px = 0.5,
                     .active_block_count = 54321,
                     .visible_block_count = 6000,
                     .triangle_count = 7654321},
                    {.level = 1,
                     .max_spacing_px = 1,
                     .active_block_count = 5432,
                     .visible_block_count = 600,
                     .triangle_count = 76543}};
  EXPECT_EQ(MeasuresToJson({surface}, "").at("surfaces").at(0).at("levels"), Json::parse(R"([
    {"level": 0, "max_spacing_px": 0.5, "active_block_count": 54321,
     "visible_block_count": 6000, "triangle_count": 7654321},
    {"level": 1, "max_spacing_px": 1.0, "active_block_count": 5432,
     "visible_block_count": 600, "triangle_count": 76543}])"));
  const std::string table = LevelCostsTable({Open(), surface});
  EXPECT_EQ(std::count(table.begin(), table.end(), '\n'), 3) << table;
  EXPECT_THAT(table, HasSubstr("54,321"));
  EXPECT_THAT(table, HasSubstr("7,654,321"));
  EXPECT_THAT(table, HasSubstr("76,543"));
}

}  // namespace
}  // namespace isoscope::cli
