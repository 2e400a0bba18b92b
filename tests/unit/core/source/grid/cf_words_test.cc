#include "core/source/grid/cf_words.h"

#include <string>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

namespace isoscope::source {
namespace {

TEST(CfWordsTest, EveryUnitOfPressureIsVerticalAndDown) {
  for (const char* units : {"Pa", "hPa", "kPa", "mbar", "mb", "millibar", "millibars", "Millibars",
                            "bar", "dbar", "decibar", "decibars", "atm", "atmosphere", "pascal",
                            "hectopascal", "100 Pa", " hPa ", "N m-2"}) {
    EXPECT_TRUE(IsCfPressure(units)) << units;
    EXPECT_EQ(CfLetterOfUnits(units), 'Z') << units;
    EXPECT_EQ(CfDirectionOfUnits(units), CfDirection::kDown) << units;
  }
  for (const char* units : {"", "m", "K", "1", "Pa s", "Pa s-1", "degrees", "level", "x Pa"}) {
    EXPECT_FALSE(IsCfPressure(units)) << units;
    EXPECT_EQ(CfDirectionOfUnits(units), CfDirection::kUnknown) << units;
  }
  EXPECT_EQ(CfDirectionOfUnits("sigma_level"), CfDirection::kDown);
}

TEST(CfWordsTest, UnitsTellAnAxis) {
  for (const auto& [units, letter] :
       std::vector<std::pair<const char*, char>>{{"degrees_east", 'X'},
                                                 {"degreeE", 'X'},
                                                 {"degrees_E", 'X'},
                                                 {"degreesN", 'Y'},
                                                 {"degree_north", 'Y'},
                                                 {"level", 'Z'},
                                                 {"layer", 'Z'},
                                                 {"sigma_level", 'Z'},
                                                 {"hours since 1900-01-01", 'T'},
                                                 {"degrees", '?'},
                                                 {"m", '?'},
                                                 {"", '?'}}) {
    EXPECT_EQ(CfLetterOfUnits(units), letter) << units;
  }
}

TEST(CfWordsTest, StandardNamesTellAnAxisAndItsDirection) {
  struct Case {
    const char* name;
    char letter;
    CfDirection direction = CfDirection::kUnknown;
  };
  for (const Case& c :
       {Case{"depth", 'Z', CfDirection::kDown},
        Case{"depth_below_geoid", 'Z', CfDirection::kDown},
        Case{"air_pressure", 'Z', CfDirection::kDown},
        Case{"sea_water_pressure", 'Z', CfDirection::kDown},
        Case{"atmosphere_sigma_coordinate", 'Z', CfDirection::kDown},
        Case{"atmosphere_hybrid_sigma_pressure_coordinate", 'Z', CfDirection::kDown},
        Case{"height", 'Z', CfDirection::kUp},
        Case{"Altitude", 'Z', CfDirection::kUp},
        Case{"height_above_mean_sea_level", 'Z', CfDirection::kUp},
        Case{"geopotential_height", 'Z', CfDirection::kUp},
        Case{"atmosphere_ln_pressure_coordinate", 'Z', CfDirection::kUp},
        Case{"atmosphere_hybrid_height_coordinate", 'Z', CfDirection::kUp},
        Case{"ocean_sigma_coordinate", 'Z', CfDirection::kUp},
        Case{"ocean_s_coordinate_g2", 'Z', CfDirection::kUp},
        Case{"model_level_number", 'Z'},
        Case{"realization", 'C'},
        Case{"time", 'T'},
        Case{"longitude", 'X'},
        Case{"projection_y_coordinate", 'Y'},
        Case{"air_temperature", '?'},
        Case{"", '?'}}) {
    EXPECT_EQ(CfLetterOfStandardName(c.name), c.letter) << c.name;
    EXPECT_EQ(CfDirectionOfStandardName(c.name), c.direction) << c.name;
  }
}

TEST(CfWordsTest, NamesOfDimensions) {
  for (const auto& [name, letter] :
       std::vector<std::pair<const char*, char>>{{"lon", 'X'},
                                                 {"nx", 'X'},
                                                 {"Latitude", 'Y'},
                                                 {"lev", 'Z'},
                                                 {"pressure_level", 'Z'},
                                                 {"depth", 'Z'},
                                                 {"member", 'C'},
                                                 {"ensemble", 'C'},
                                                 {"time", 'T'},
                                                 {"j", '?'},
                                                 {"dim0", '?'}}) {
    EXPECT_EQ(CfLetterOfDimension(name), letter) << name;
  }
}

TEST(CfWordsTest, LengthsInMetres) {
  for (const auto& [unit, metres] :
       std::vector<std::pair<const char*, double>>{{"m", 1},
                                                   {"metres", 1},
                                                   {"Meter", 1},
                                                   {"km", 1e3},
                                                   {"kilometre", 1e3},
                                                   {"dm", 0.1},
                                                   {"centimeters", 0.01},
                                                   {"mm", 1e-3},
                                                   {"Mm", 1e6},
                                                   {"um", 1e-6},
                                                   {"microns", 1e-6},
                                                   {"micrometre", 1e-6},
                                                   {"nanometers", 1e-9},
                                                   {"angstrom", 1e-10},
                                                   {"ft", 0.3048},
                                                   {"feet", 0.3048},
                                                   {"inches", 0.0254},
                                                   {"1000 m", 1000},
                                                   {"2 km", 2000},
                                                   {"MM", 0},
                                                   {"", 0},
                                                   {"degrees", 0},
                                                   {"hPa", 0},
                                                   {"m s-1", 0},
                                                   {"kilofoot", 0},
                                                   {"meterss", 0}}) {
    EXPECT_DOUBLE_EQ(MetresOfCfUnit(unit), metres) << unit;
  }
}

TEST(CfWordsTest, AnglesInDegrees) {
  for (const auto& [unit, degrees] :
       std::vector<std::pair<std::string, double>>{{"degrees", 1},
                                                   {"Degree", 1},
                                                   {"degrees_north", 1},
                                                   {"degree_E", 1},
                                                   {"radian", 57.295779513082323},
                                                   {"rad", 57.295779513082323},
                                                   {"microradian", 57.295779513082323e-6},
                                                   {"arcminute", 1.0 / 60},
                                                   {"0.5 degrees", 0.5},
                                                   {"level", 0},
                                                   {"m", 0},
                                                   {"", 0}}) {
    EXPECT_DOUBLE_EQ(DegreesOfCfUnit(unit), degrees) << unit;
  }
}

}  // namespace
}  // namespace isoscope::source
