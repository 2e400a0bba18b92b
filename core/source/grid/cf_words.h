// Words of the CF conventions: units and standard names that tell the meaning of an axis.

#ifndef ISOSCOPE_CORE_SOURCE_GRID_CF_WORDS_H_
#define ISOSCOPE_CORE_SOURCE_GRID_CF_WORDS_H_

#include <string>

#include "absl/strings/string_view.h"

namespace isoscope::source {

// The direction in which a vertical coordinate grows.
enum class CfDirection { kUnknown, kUp, kDown };

// Returns X and Y for units of longitude and latitude; Z for units of pressure, and for level,
// layer and sigma_level of COARDS; T for "days since ..."; '?' for others.
char CfLetterOfUnits(absl::string_view units);
// Returns T, C, Z, Y or X by a standard name, in any case; '?' for others.
char CfLetterOfStandardName(absl::string_view name);
// The same by the name of a dimension.
char CfLetterOfDimension(absl::string_view name);

// Returns kDown for units of pressure, and for sigma_level.
CfDirection CfDirectionOfUnits(absl::string_view units);
CfDirection CfDirectionOfStandardName(absl::string_view name);

bool IsCfPressure(absl::string_view units);

// 0 if the unit is none of length. "1000 m" is a unit, too.
double MetresOfCfUnit(absl::string_view unit);
// 0 if the unit is none of an angle.
double DegreesOfCfUnit(absl::string_view unit);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_GRID_CF_WORDS_H_
