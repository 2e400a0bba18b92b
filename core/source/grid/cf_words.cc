// Units are words of UDUNITS, of which these tables have what files use. A factor may stand in
// front: "100 Pa". Names of a length must have their case: Mm is no mm.
//
// Source: CF Metadata Conventions 1.10, sections 4.1 to 4.3 and Appendix D, and the table of
// standard names, https://cfconventions.org; the COARDS conventions, for level, layer, sigma_level.

#include "core/source/grid/cf_words.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <numbers>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/strip.h"

#include "core/source/grid/axis_order.h"

namespace isoscope::source {
namespace {

struct CfWord {
  const char* text;
  char letter;
};
constexpr std::array<CfWord, 15> kCfUnits{{{"degrees_east", 'X'},
                                           {"degree_east", 'X'},
                                           {"degrees_e", 'X'},
                                           {"degree_e", 'X'},
                                           {"degreese", 'X'},
                                           {"degreee", 'X'},
                                           {"degrees_north", 'Y'},
                                           {"degree_north", 'Y'},
                                           {"degrees_n", 'Y'},
                                           {"degree_n", 'Y'},
                                           {"degreesn", 'Y'},
                                           {"degreen", 'Y'},
                                           {"level", 'Z'},
                                           {"layer", 'Z'},
                                           {"sigma_level", 'Z'}}};

constexpr std::array<const char*, 51> kCfPressures{{"pa",
                                                    "hpa",
                                                    "kpa",
                                                    "mpa",
                                                    "dapa",
                                                    "pascal",
                                                    "pascals",
                                                    "bar",
                                                    "bars",
                                                    "mbar",
                                                    "mbars",
                                                    "millibar",
                                                    "millibars",
                                                    "mb",
                                                    "dbar",
                                                    "dbars",
                                                    "decibar",
                                                    "decibars",
                                                    "cbar",
                                                    "centibar",
                                                    "centibars",
                                                    "ubar",
                                                    "microbar",
                                                    "microbars",
                                                    "kbar",
                                                    "kilobar",
                                                    "atm",
                                                    "atmosphere",
                                                    "atmospheres",
                                                    "torr",
                                                    "mmhg",
                                                    "mm_hg",
                                                    "inhg",
                                                    "in_hg",
                                                    "psi",
                                                    "hectopascal",
                                                    "hectopascals",
                                                    "kilopascal",
                                                    "kilopascals",
                                                    "megapascal",
                                                    "megapascals",
                                                    "n m-2",
                                                    "n/m2",
                                                    "n/m^2",
                                                    "n m^-2",
                                                    "n m**-2",
                                                    "n.m-2",
                                                    "kg m-1 s-2",
                                                    "dyn cm-2",
                                                    "std_atmosphere",
                                                    "standard_atmosphere"}};

struct CfStandardName {
  const char* text;
  char letter;
  CfDirection direction = CfDirection::kUnknown;
};
constexpr std::array<CfStandardName, 36> kCfStandardNames{
    {{"time", 'T'},
     {"realization", 'C'},
     {"longitude", 'X'},
     {"grid_longitude", 'X'},
     {"projection_x_coordinate", 'X'},
     {"projection_x_angular_coordinate", 'X'},
     {"latitude", 'Y'},
     {"grid_latitude", 'Y'},
     {"projection_y_coordinate", 'Y'},
     {"projection_y_angular_coordinate", 'Y'},
     {"height", 'Z', CfDirection::kUp},
     {"altitude", 'Z', CfDirection::kUp},
     {"barometric_altitude", 'Z', CfDirection::kUp},
     {"geopotential", 'Z', CfDirection::kUp},
     {"geopotential_height", 'Z', CfDirection::kUp},
     {"air_potential_temperature", 'Z', CfDirection::kUp},
     {"atmosphere_ln_pressure_coordinate", 'Z', CfDirection::kUp},
     {"atmosphere_hybrid_height_coordinate", 'Z', CfDirection::kUp},
     {"atmosphere_sleve_coordinate", 'Z', CfDirection::kUp},
     {"ocean_sigma_coordinate", 'Z', CfDirection::kUp},
     {"ocean_s_coordinate", 'Z', CfDirection::kUp},
     {"ocean_s_coordinate_g1", 'Z', CfDirection::kUp},
     {"ocean_s_coordinate_g2", 'Z', CfDirection::kUp},
     {"ocean_sigma_z_coordinate", 'Z', CfDirection::kUp},
     {"ocean_double_sigma_coordinate", 'Z'},
     {"depth", 'Z', CfDirection::kDown},
     {"air_pressure", 'Z', CfDirection::kDown},
     {"sea_water_pressure", 'Z', CfDirection::kDown},
     {"sea_water_pressure_due_to_sea_water", 'Z', CfDirection::kDown},
     {"sea_water_potential_density", 'Z', CfDirection::kDown},
     {"sea_water_sigma_t", 'Z', CfDirection::kDown},
     {"sea_water_sigma_theta", 'Z', CfDirection::kDown},
     {"atmosphere_sigma_coordinate", 'Z', CfDirection::kDown},
     {"atmosphere_hybrid_sigma_pressure_coordinate", 'Z', CfDirection::kDown},
     {"hybrid_sigma_pressure", 'Z', CfDirection::kDown},  // CF before 1.0
     {"model_level_number", 'Z'}}};

constexpr std::array<CfWord, 18> kCfDimensions{{{"lon", 'X'},
                                                {"lons", 'X'},
                                                {"west_east", 'X'},
                                                {"lat", 'Y'},
                                                {"lats", 'Y'},
                                                {"south_north", 'Y'},
                                                {"lev", 'Z'},
                                                {"levels", 'Z'},
                                                {"level", 'Z'},
                                                {"plev", 'Z'},
                                                {"pressure_level", 'Z'},
                                                {"bottom_top", 'Z'},
                                                {"elevation", 'Z'},
                                                {"member", 'C'},
                                                {"members", 'C'},
                                                {"ensemble", 'C'},
                                                {"ensemble_member", 'C'},
                                                {"ens", 'C'}}};

struct LengthWord {
  const char* text;
  double metres;
};
constexpr std::array<LengthWord, 20> kLengthSymbols{
    {{"m", 1},       {"km", 1e3},    {"hm", 1e2},      {"dam", 1e1},        {"dm", 1e-1},
     {"cm", 1e-2},   {"mm", 1e-3},   {"um", 1e-6},     {"\xc2\xb5m", 1e-6}, {"\xce\xbcm", 1e-6},
     {"nm", 1e-9},   {"pm", 1e-12},  {"Mm", 1e6},      {"Gm", 1e9},         {"ft", 0.3048},
     {"in", 0.0254}, {"yd", 0.9144}, {"mi", 1609.344}, {"nmile", 1852},     {"\xc3\x85", 1e-10}}};
// A unit of length in lower case, without the s of the plural.
struct LengthStem {
  const char* text;
  double metres;
  bool takes_prefix = false;
};
constexpr std::array<LengthStem, 12> kLengthStems{{{"metre", 1, true},
                                                   {"meter", 1, true},
                                                   {"micron", 1e-6},
                                                   {"angstrom", 1e-10},
                                                   {"foot", 0.3048},
                                                   {"feet", 0.3048},
                                                   {"international_foot", 0.3048},
                                                   {"us_survey_foot", 1200.0 / 3937},
                                                   {"inch", 0.0254},
                                                   {"yard", 0.9144},
                                                   {"mile", 1609.344},
                                                   {"nautical_mile", 1852}}};
constexpr std::array<LengthWord, 8> kLengthPrefixes{{{"", 1},
                                                     {"kilo", 1e3},
                                                     {"hecto", 1e2},
                                                     {"deci", 1e-1},
                                                     {"centi", 1e-2},
                                                     {"milli", 1e-3},
                                                     {"micro", 1e-6},
                                                     {"nano", 1e-9}}};

// A unit of angles in lower case. Those of kCfUnits for longitude and latitude are degrees, too.
struct AngleWord {
  const char* text;
  double degrees;
};
constexpr double kDegreesOfRadian = 180 / std::numbers::pi;
constexpr std::array<AngleWord, 22> kCfAngles{{{"degree", 1},
                                               {"degrees", 1},
                                               {"deg", 1},
                                               {"arc_degree", 1},
                                               {"arc_degrees", 1},
                                               {"angular_degree", 1},
                                               {"angular_degrees", 1},
                                               {"\xc2\xb0", 1},
                                               {"radian", kDegreesOfRadian},
                                               {"radians", kDegreesOfRadian},
                                               {"rad", kDegreesOfRadian},
                                               {"milliradian", 1e-3 * kDegreesOfRadian},
                                               {"milliradians", 1e-3 * kDegreesOfRadian},
                                               {"mrad", 1e-3 * kDegreesOfRadian},
                                               {"microradian", 1e-6 * kDegreesOfRadian},
                                               {"microradians", 1e-6 * kDegreesOfRadian},
                                               {"urad", 1e-6 * kDegreesOfRadian},
                                               {"arc_minute", 1.0 / 60},
                                               {"arc_minutes", 1.0 / 60},
                                               {"arcminute", 1.0 / 60},
                                               {"arc_second", 1.0 / 3600},
                                               {"arcsecond", 1.0 / 3600}}};

std::string CfLower(absl::string_view text) {
  return absl::AsciiStrToLower(absl::StripAsciiWhitespace(text));
}

template <std::size_t kCount>
char CfLetterIn(const std::array<CfWord, kCount>& words, const std::string& lower) {
  const auto* const found = std::find_if(words.begin(), words.end(),
                                         [&](const CfWord& word) { return lower == word.text; });
  return found == words.end() ? '?' : found->letter;
}

const CfStandardName* FindCfStandardName(absl::string_view name) {
  const std::string lower = CfLower(name);
  const auto* const found =
      std::find_if(kCfStandardNames.begin(), kCfStandardNames.end(),
                   [&](const CfStandardName& known) { return lower == known.text; });
  return found == kCfStandardNames.end() ? nullptr : found;
}

// "100 Pa" in parts; a factor of 1 if there is none above 0.
std::pair<double, absl::string_view> SplitCfFactor(absl::string_view units) {
  units = absl::StripAsciiWhitespace(units);
  const std::size_t space = units.find(' ');
  double factor = 0;
  if (space != absl::string_view::npos && absl::SimpleAtod(units.substr(0, space), &factor) &&
      factor > 0 && factor < 1e30) {
    return {factor, absl::StripAsciiWhitespace(units.substr(space))};
  }
  return {1, units};
}

double MetresOfCfWord(absl::string_view unit) {
  for (const LengthWord& symbol : kLengthSymbols) {
    if (unit == symbol.text) {
      return symbol.metres;
    }
  }
  const std::string lower = CfLower(unit);
  for (const LengthWord& prefix : kLengthPrefixes) {
    absl::string_view rest = lower;
    if (!absl::ConsumePrefix(&rest, prefix.text)) {
      continue;
    }
    for (const LengthStem& stem : kLengthStems) {
      absl::string_view end = rest;
      if ((stem.takes_prefix || prefix.text[0] == '\0') && absl::ConsumePrefix(&end, stem.text) &&
          (end.empty() || end == "s" || end == "es")) {
        return prefix.metres * stem.metres;
      }
    }
  }
  return 0;
}

}  // namespace

bool IsCfPressure(absl::string_view units) {
  const std::string lower = CfLower(SplitCfFactor(units).second);
  return std::find(kCfPressures.begin(), kCfPressures.end(), lower) != kCfPressures.end();
}

char CfLetterOfUnits(absl::string_view units) {
  if (absl::StrContains(units, " since ")) {
    return 'T';
  }
  return IsCfPressure(units) ? 'Z' : CfLetterIn(kCfUnits, CfLower(units));
}

char CfLetterOfStandardName(absl::string_view name) {
  const CfStandardName* const known = FindCfStandardName(name);
  return known != nullptr                                           ? known->letter
         : CfDirectionOfStandardName(name) != CfDirection::kUnknown ? 'Z'
                                                                    : '?';
}

char CfLetterOfDimension(absl::string_view name) {
  const char by_label = AxisLetterOf(name);
  if (by_label != '?') {
    return by_label;
  }
  const char by_word = CfLetterIn(kCfDimensions, CfLower(name));
  return by_word != '?' ? by_word : CfLetterOfStandardName(name);
}

CfDirection CfDirectionOfUnits(absl::string_view units) {
  return IsCfPressure(units) || CfLower(units) == "sigma_level" ? CfDirection::kDown
                                                                : CfDirection::kUnknown;
}

CfDirection CfDirectionOfStandardName(absl::string_view name) {
  if (const CfStandardName* const known = FindCfStandardName(name); known != nullptr) {
    return known->direction;
  }
  const std::string lower = CfLower(name);
  return absl::StartsWith(lower, "height_above_")  ? CfDirection::kUp
         : absl::StartsWith(lower, "depth_below_") ? CfDirection::kDown
                                                   : CfDirection::kUnknown;
}

double MetresOfCfUnit(absl::string_view unit) {
  const auto [factor, word] = SplitCfFactor(unit);
  return factor * MetresOfCfWord(word);
}

double DegreesOfCfUnit(absl::string_view unit) {
  const auto [factor, word] = SplitCfFactor(unit);
  const std::string lower = CfLower(word);
  if (const char letter = CfLetterIn(kCfUnits, lower); letter == 'X' || letter == 'Y') {
    return factor;
  }
  const auto* const found =
      std::find_if(kCfAngles.begin(), kCfAngles.end(),
                   [&](const AngleWord& angle) { return lower == angle.text; });
  return found == kCfAngles.end() ? 0 : factor * found->degrees;
}

}  // namespace isoscope::source
