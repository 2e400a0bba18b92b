#include "core/source/grid/cf_grid.h"

#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

TEST(CfGridTest, AttributesGoBeforeNames) {
  struct Case {
    CfAxis axis;
    char letter;
  };
  for (const Case& c : std::vector<Case>{{{.name = "a", .axis = "z"}, 'Z'},
                                         {{.name = "x", .axis = "Y"}, 'Y'},
                                         {{.name = "a", .units = "days since 1990-01-01"}, 'T'},
                                         {{.name = "a", .units = "degrees_east"}, 'X'},
                                         {{.name = "a", .units = "Degrees_North"}, 'Y'},
                                         {{.name = "a", .units = "hPa"}, 'Z'},
                                         {{.name = "a", .standard_name = "depth"}, 'Z'},
                                         {{.name = "a", .positive = "up"}, 'Z'},
                                         {{.name = "lon"}, 'X'},
                                         {{.name = "Latitude"}, 'Y'},
                                         {{.name = "lev"}, 'Z'},
                                         {{.name = "time"}, 'T'},
                                         {{.name = "z"}, 'Z'},
                                         {{.name = "component"}, 'C'},
                                         {{.name = "a", .standard_name = "realization"}, 'C'},
                                         {{.name = "a", .units = "millibars"}, 'Z'},
                                         {{.name = "lat", .units = "hPa"}, 'Z'},
                                         {{.name = "member"}, 'C'},
                                         {{.name = "run"}, '?'}}) {
    EXPECT_EQ(CfLetterOf(c.axis), c.letter) << c.axis.name << " " << c.axis.units;
  }
}

std::vector<CfAxis> Axes(const std::vector<std::string>& names, std::int64_t size = 4) {
  std::vector<CfAxis> axes;
  for (const std::string& name : names) {
    axes.push_back({.name = name, .size = name == "one" ? 1 : size});
  }
  return axes;
}

TEST(CfGridTest, FindsTheAxesOfSpaceInAnyOrder) {
  struct Case {
    std::vector<std::string> names;
    std::string space;  // numbers of axes, then letters; "" if it is no volume
  };
  for (const Case& c : std::vector<Case>{{{"z", "y", "x"}, "012ZYX"},
                                         {{"time", "lev", "lat", "lon"}, "123ZYX"},
                                         {{"lon", "lat", "lev", "time"}, "012XYZ"},
                                         {{"one", "z", "y", "x"}, "123ZYX"},
                                         {{"p", "q", "r"}, "012ZYX"},
                                         {{"time", "a", "y", "x"}, "123ZYX"},
                                         {{"x", "a", "b"}, "012XZY"},
                                         {{"time", "lat", "lon"}, ""},
                                         {{"p", "q", "r", "s"}, ""},
                                         {{"run", "z", "y", "x"}, ""},
                                         {{"member", "z", "y", "x"}, "123ZYX"},
                                         {{"member", "lat", "lon"}, ""},
                                         {{"height", "lat", "lon"}, "012ZYX"},
                                         {{"depth", "height", "width"}, "012ZYX"},
                                         {{"z", "z", "y", "x"}, ""},
                                         {{"t", "time", "z", "y", "x"}, ""}}) {
    const auto roles = CfRolesOf(Axes(c.names));
    std::string got;
    if (roles.has_value()) {
      for (const std::size_t axis : roles->space) {
        got += std::to_string(axis);
      }
      got += std::string(roles->letters.begin(), roles->letters.end());
    }
    EXPECT_EQ(got, c.space) << ::testing::PrintToString(c.names);
  }
  std::vector<CfAxis> twice = Axes({"time", "step", "z", "y", "x"});  // a reference time of one
  twice[0].size = 1;
  EXPECT_EQ(CfRolesOf(twice)->time, 1u);
  twice[1].size = 1;
  EXPECT_EQ(CfRolesOf(twice)->time, 0u);
  EXPECT_EQ(CfRolesOf(Axes({"z", "y", "x"}, 1)), std::nullopt);
  EXPECT_EQ(CfRolesOf(Axes({"c", "time", "z", "y", "x"}))->component, 0u);
}

math::Vec3d At(const volume::GridGeometry& geometry, const math::Vec3d& index) {
  return math::TransformPoint(geometry.world_from_index(), index);
}

TEST(CfGridTest, FirstAndLastSampleLieAtTheirCoordinates) {
  std::vector<CfAxis> axes = Axes({"lev", "lat", "lon"});
  axes[0].values = {100, 80, 60, 40};
  axes[1].values = {30, 20, 10, 0};
  axes[2].values = {-1.5, -1, -0.5, 0};
  for (const bool is_down : {false, true}) {
    axes[0].positive = is_down ? "down" : "up";
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto grid, CfGridOf(axes, *CfRolesOf(axes)));
    const double sign = is_down ? -1 : 1;
    EXPECT_EQ(At(grid, {0, 0, 0}), (math::Vec3d{-1.5, 30, sign * 100}));
    EXPECT_EQ(At(grid, {3, 3, 3}), (math::Vec3d{0, 0, sign * 40}));
    EXPECT_EQ(At(grid, {3, 0, 0}), (math::Vec3d{0, 30, sign * 100}));
  }
  // The fastest axis is Z.
  std::vector<CfAxis> turned = Axes({"x", "y", "z"});
  turned[0].values = {0, 2, 4, 6};
  turned[2].values = {5, 6, 7, 8};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto grid, CfGridOf(turned, *CfRolesOf(turned)));
  EXPECT_EQ(At(grid, {3, 0, 0}), (math::Vec3d{0, 0, 8}));
  EXPECT_EQ(At(grid, {0, 1, 3}), (math::Vec3d{6, 1, 5}));
}

// The world's z of the first and the last sample of an axis of 1000, 900, ... 700.
std::pair<double, double> LevelsOf(CfAxis level,
                                   std::vector<double> values = {1000, 900, 800, 700}) {
  std::vector<CfAxis> axes = Axes({level.name, "y", "x"});
  level.size = 4;
  level.values = std::move(values);
  axes[1].values = axes[2].values = {0, 1, 2, 3};  // no axis is half given
  axes[0] = std::move(level);
  const auto grid = CfGridOf(axes, *CfRolesOf(axes));
  EXPECT_TRUE(grid.ok()) << grid.status();
  return grid.ok() ? std::pair{At(*grid, {0, 0, 0}).z, At(*grid, {0, 0, 3}).z}
                   : std::pair{0.0, 0.0};
}

// Symptom: lengths became metres beside an axis whose unit nobody knows.
TEST(CfGridTest, AnAxisWithoutAUnitFitsLengthsOfOneUnitAlone) {
  std::vector<CfAxis> axes = Axes({"z", "y", "x"});
  for (CfAxis& axis : axes) {
    axis.values = {0, 1, 2, 3};
  }
  axes[1].units = "mm";
  axes[2].units = "mm";
  EXPECT_TRUE(CfGridOf(axes, *CfRolesOf(axes)).ok());
  axes[2].units = "um";
  EXPECT_THAT(CfGridOf(axes, *CfRolesOf(axes)).status(),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("mm and um"), HasSubstr("axis \"z\""),
                             HasSubstr("--spacing X,Y,Z"))));
  EXPECT_TRUE(CfGridOf(axes, *CfRolesOf(axes), {.has_spacing = true}).ok());
  axes[0].units = "m";
  EXPECT_TRUE(CfGridOf(axes, *CfRolesOf(axes)).ok());
}

TEST(CfGridTest, VerticalCoordinatesPointWhereTheConventionSays) {
  const std::pair<double, double> down{-1000, -700};
  const std::pair<double, double> up{1000, 700};
  // Units of pressure need no `positive`.
  for (const char* units : {"hPa", "Pa", "millibars", "mb", "dbar", "atm"}) {
    EXPECT_EQ(LevelsOf({.name = "level", .units = units}), down) << units;
    EXPECT_EQ(LevelsOf({.name = "level", .positive = "up", .units = units}), up) << units;
  }
  // `positive` goes before names, and in any case.
  EXPECT_EQ(LevelsOf({.name = "a", .positive = "Down", .standard_name = "height"}), down);
  EXPECT_EQ(LevelsOf({.name = "a", .positive = "UP", .standard_name = "depth"}), up);
  EXPECT_EQ(LevelsOf({.name = "a", .standard_name = "depth", .units = "m"}), down);
  EXPECT_EQ(LevelsOf({.name = "a", .standard_name = "air_pressure"}), down);
  EXPECT_EQ(LevelsOf({.name = "a", .standard_name = "altitude", .units = "m"}), up);
  EXPECT_EQ(LevelsOf({.name = "a", .units = "sigma_level"}), down);
  EXPECT_EQ(LevelsOf({.name = "lev", .units = "level"}), up);
  EXPECT_EQ(LevelsOf({.name = "z", .units = "m"}), up);
  // A depth by name alone, unless it has a sign already.
  EXPECT_EQ(LevelsOf({.name = "deptht", .axis = "Z", .units = "m"}), down);
  EXPECT_EQ(LevelsOf({.name = "depth"}), down);
  EXPECT_EQ(LevelsOf({.name = "depth", .units = "K"}), up);
  EXPECT_EQ(LevelsOf({.name = "depth"}, {-1000, -900, -800, -700}), down);
  // Not of another axis than Z.
  std::vector<CfAxis> axes = Axes({"z", "y", "x"});
  axes[1].axis = "Y";
  axes[1].units = "hPa";
  axes[1].values = {1, 2, 3, 4};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto grid, CfGridOf(axes, *CfRolesOf(axes)));
  EXPECT_EQ(At(grid, {0, 3, 0}).y, 4);
  axes[0].positive = "upwards";
  EXPECT_THAT(CfGridOf(axes, *CfRolesOf(axes)),
              StatusIs(kInvalid, AllOf(HasSubstr("\"z\""), HasSubstr("\"upwards\""))));
}

TEST(CfGridTest, LettersGiveTheMeaningOfAxes) {
  std::vector<CfAxis> axes = Axes({"run", "q", "one", "p", "r"});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CfRoles roles, CfRolesFrom("TX-ZY", axes));
  EXPECT_THAT(roles.space, ElementsAre(1, 3, 4));
  EXPECT_THAT(roles.letters, ElementsAre('X', 'Z', 'Y'));
  EXPECT_EQ(roles.time, 0u);
  EXPECT_EQ(roles.component, std::nullopt);
  for (const char* letters : {"TZYX", "TZ-YXC", "-Z-YX", "ZZ-YX", "TTZYX", "CZYX-", "tz-yx", ""}) {
    EXPECT_THAT(CfRolesFrom(letters, axes),
                StatusIs(kInvalid, AllOf(HasSubstr("--axes"), HasSubstr("run (?, 4)"),
                                         HasSubstr("one (?, 1)"))))
        << letters;
  }
}

TEST(CfGridTest, SuggestedLettersAreTaken) {
  struct Case {
    std::vector<std::string> names;
    std::string letters;
  };
  for (const Case& c : std::vector<Case>{{{"run", "z", "y", "x"}, "CZYX"},
                                         {{"time", "run", "lev", "lat", "lon"}, "TCZYX"},
                                         {{"run", "one", "lev", "lat", "lon"}, "C-ZYX"},
                                         {{"member", "run", "lev", "lat", "lon"}, "CTZYX"},
                                         {{"t", "time", "z", "y", "x"}, "TCZYX"},
                                         {{"p", "q", "r", "s"}, "ZYXC"},
                                         {{"a", "b", "c0", "d", "e", "f"}, ""},
                                         {{"time", "lat", "lon"}, ""},
                                         {{"lat", "lon"}, ""}}) {
    const std::vector<CfAxis> axes = Axes(c.names);
    EXPECT_EQ(SuggestCfAxes(axes), c.letters) << ::testing::PrintToString(c.names);
    EXPECT_EQ(CfRolesFrom(c.letters, axes).ok(), !c.letters.empty());
  }
}

TEST(CfGridTest, RefusesUnevenAxesWithTheDeviation) {
  std::vector<CfAxis> axes = Axes({"lev", "lat", "lon"});
  axes[0].values = {0, 10, 25, 30};
  EXPECT_THAT(CfGridOf(axes, *CfRolesOf(axes)),
              StatusIs(kInvalid, AllOf(HasSubstr("\"lev\""), HasSubstr("coordinate 2 is 25"),
                                       HasSubstr("5 from where steps of 10"))));
  axes[0].values = {0, 10.009, 20, 30};
  EXPECT_TRUE(CfGridOf(axes, *CfRolesOf(axes)).ok());
  axes[0].values = {0, 10.02, 20, 30};
  EXPECT_FALSE(CfGridOf(axes, *CfRolesOf(axes)).ok());
  // 32-bit floats far from zero: as even as they can be.
  axes[0].values = {1e7, 1e7 + 1, 1e7 + 1, 1e7 + 3};
  EXPECT_FALSE(CfGridOf(axes, *CfRolesOf(axes)).ok());
  axes[0].is_single = true;
  EXPECT_TRUE(CfGridOf(axes, *CfRolesOf(axes)).ok());
  axes[0].values = {3, 3, 3, 3};
  EXPECT_THAT(CfGridOf(axes, *CfRolesOf(axes)), StatusIs(kInvalid, HasSubstr("ends at 3")));
  axes[0].values = {0, 1, NAN, 3};
  EXPECT_THAT(CfGridOf(axes, *CfRolesOf(axes)),
              StatusIs(kInvalid, AllOf(HasSubstr("\"lev\""), HasSubstr("coordinate 2"),
                                       HasSubstr("missing"))));
}

TEST(CfGridTest, UnevenAxesHaveTheirDistances) {
  std::vector<CfAxis> axes = Axes({"lev", "lat", "lon"});
  axes[0].values = {1000, 850, 500, 100};
  axes[0].positive = "down";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto grid, CfUnevenGridOf(axes, *CfRolesOf(axes)));
  EXPECT_THAT(grid.distances[2], ElementsAre(0, 150, 500, 900));
  EXPECT_THAT(grid.distances[0], ElementsAre());
  EXPECT_EQ(At(grid.geometry, {0, 0, 0}), (math::Vec3d{0, 0, -1000}));
  EXPECT_EQ(At(grid.geometry, {0, 0, 3}), (math::Vec3d{0, 0, -100}));
  axes[0].values = {1000, 850, 900, 100};
  EXPECT_THAT(CfUnevenGridOf(axes, *CfRolesOf(axes)),
              StatusIs(kInvalid, HasSubstr("coordinate 900 behind 850")));
}

TEST(CfGridTest, SeveralUnitsOfLengthBecomeMetres) {
  std::vector<CfAxis> axes = Axes({"z", "y", "x"});
  axes[0].values = {0, 10, 20, 40};
  axes[1].values = axes[2].values = {1, 2, 3, 4};
  axes[0].units = "cm";
  axes[1].units = axes[2].units = "km";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto grid, CfUnevenGridOf(axes, *CfRolesOf(axes)));
  EXPECT_LT(math::Length(At(grid.geometry, {3, 3, 3}) - math::Vec3d{4000, 4000, 0.4}), 1e-9);
  EXPECT_LT(math::Length(At(grid.geometry, {0, 0, 0}) - math::Vec3d{1000, 1000, 0}), 1e-9);
  EXPECT_THAT(grid.distances[2], ElementsAre(0, 0.1, 0.2, 0.4));
  EXPECT_EQ(CfLengthUnit(axes, *CfRolesOf(axes)), "m");
  axes[0].units = "km";  // one unit stays
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(grid, CfUnevenGridOf(axes, *CfRolesOf(axes)));
  EXPECT_EQ(At(grid.geometry, {3, 3, 3}), (math::Vec3d{4, 4, 40}));
  axes[0].units = "degrees_north";  // no length
  axes[0].axis = "Z";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(grid, CfUnevenGridOf(axes, *CfRolesOf(axes)));
  EXPECT_EQ(At(grid.geometry, {3, 3, 3}), (math::Vec3d{4, 4, 40}));
  EXPECT_EQ(CfLengthUnit(axes, *CfRolesOf(axes)), "");
}

// Evenly spaced coordinates of an axis.
CfAxis Even(const std::string& name, const std::string& units, double step) {
  return {.name = name, .size = 4, .units = units, .values = {0, step, 2 * step, 3 * step}};
}

TEST(CfGridTest, LengthsBecomeMetresBesideAxesOfOtherUnits) {
  for (const char* other : {"hPa", "degrees", "K"}) {
    const std::vector<CfAxis> axes{Even("z", other, 100), Even("y", "km", 1), Even("x", "m", 1000)};
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto grid, CfGridOf(axes, *CfRolesOf(axes)));
    EXPECT_EQ(grid.spacing, (math::Vec3d{1000, 1000, 100})) << other;
    EXPECT_EQ(CfLengthUnit(axes, *CfRolesOf(axes)), "") << other;
  }
  // One unit of length stays.
  const std::vector<CfAxis> one{Even("z", "hPa", 100), Even("y", "km", 1), Even("x", "km", 2)};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto grid, CfGridOf(one, *CfRolesOf(one)));
  EXPECT_EQ(grid.spacing, (math::Vec3d{2, 1, 100}));
}

TEST(CfGridTest, AnglesBecomeDegrees) {
  std::vector<CfAxis> axes{Even("z", "m", 10), Even("lat", "radian", 0.5),
                           Even("lon", "degrees_east", 2)};
  axes[1].standard_name = "latitude";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto grid, CfGridOf(axes, *CfRolesOf(axes)));
  EXPECT_NEAR(grid.spacing.y, 28.64788975654116, 1e-12);
  EXPECT_EQ(grid.spacing.x, 2);
  EXPECT_EQ(grid.spacing.z, 10);
  axes[2].units = "radian";  // one unit stays
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto same, CfGridOf(axes, *CfRolesOf(axes)));
  EXPECT_EQ(same.spacing, (math::Vec3d{2, 0.5, 10}));
}

TEST(CfGridTest, LengthsAlongSomeAxesOnlyAreRefusedUnlessTheSpacingIsGiven) {
  std::vector<CfAxis> axes = Axes({"z", "y", "x"});
  axes[0] = Even("z", "m", 250);
  const CfRoles roles = *CfRolesOf(axes);
  const auto is_half = StatusIs(
      kInvalid, AllOf(HasSubstr("axis \"z\" has coordinates in m, and axis \"x\" has none"),
                      HasSubstr("--spacing X,Y,Z")));
  EXPECT_THAT(CfGridOf(axes, roles), is_half);
  EXPECT_THAT(CfUnevenGridOf(axes, roles), is_half);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto grid, CfGridOf(axes, roles, {.has_spacing = true}));
  EXPECT_EQ(grid.spacing, (math::Vec3d{1, 1, 250}));
  // Numbers without a unit, or of one that is no length, stand beside indices.
  for (const char* units : {"", "hPa", "level"}) {
    axes[0].units = units;
    EXPECT_TRUE(CfGridOf(axes, roles).ok()) << units;
  }
}

TEST(CfGridTest, AxisMayHaveAStepOrAFaultInPlaceOfCoordinates) {
  std::vector<CfAxis> axes = Axes({"z", "y", "x"});
  const CfRoles roles = *CfRolesOf(axes);
  for (CfAxis& axis : axes) {
    axis.units = "um";
    axis.step = 0.5;
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto grid, CfGridOf(axes, roles));
  EXPECT_EQ(grid.spacing, (math::Vec3d{0.5, 0.5, 0.5}));
  EXPECT_EQ(CfLengthUnit(axes, roles), "um");
  axes[0] = Even("z", "mm", 2);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(grid, CfGridOf(axes, roles));
  EXPECT_LT(math::Length(grid.spacing - math::Vec3d{0.5e-6, 0.5e-6, 2e-3}), 1e-15);
  axes[1].step = std::nullopt;
  axes[1].fault = "its coordinates are curved";
  EXPECT_THAT(CfGridOf(axes, roles), StatusIs(kInvalid, HasSubstr("are curved")));
  EXPECT_THAT(CfUnevenGridOf(axes, roles), StatusIs(kInvalid, HasSubstr("are curved")));
  EXPECT_TRUE(CfGridOf(axes, roles, {.has_spacing = true}).ok());
}

// Resampling needs an order, so it is no advice.
TEST(CfGridTest, AxisThatTurnsBackIsRefusedByTheCoordinateThatDoes) {
  std::vector<CfAxis> axes = Axes({"z", "lat", "lon"});
  axes[2].values = {350, 355, 0, 5};
  const CfRoles roles = *CfRolesOf(axes);
  const auto is_back =
      StatusIs(kInvalid, AllOf(HasSubstr("\"lon\" has the coordinate 0 behind 355"),
                               ::testing::Not(HasSubstr("--resample"))));
  EXPECT_THAT(CfGridOf(axes, roles), is_back);
  EXPECT_THAT(CfUnevenGridOf(axes, roles), is_back);
}

TEST(CfGridTest, UnitsAndTimes) {
  std::vector<CfAxis> axes = Axes({"z", "y", "x"});
  for (CfAxis& axis : axes) {
    axis.units = "km";
  }
  EXPECT_EQ(CfLengthUnit(axes, *CfRolesOf(axes)), "km");
  axes[0].units = "Pa";
  EXPECT_EQ(CfLengthUnit(axes, *CfRolesOf(axes)), "");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto counted, CfTimesOf({.name = "t", .size = 3}));
  EXPECT_THAT(counted, ElementsAre(0, 1, 2));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto none, CfTimesOf({.name = "t", .size = 1}));
  EXPECT_THAT(none, ElementsAre());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto one,
                                CfTimesOf({.name = "t", .size = 1, .values = {4.5}}));
  EXPECT_THAT(one, ElementsAre(4.5));
  EXPECT_THAT(CfTimesOf({.name = "t", .size = 2, .values = {1, 1}}),
              StatusIs(kInvalid, AllOf(HasSubstr("\"t\""), HasSubstr("index 1"))));
}

}  // namespace
}  // namespace isoscope::source
