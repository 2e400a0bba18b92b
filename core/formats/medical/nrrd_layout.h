// Reads what an NRRD header says of its axes, where one of four is not of space.

#ifndef ISOSCOPE_CORE_FORMATS_MEDICAL_NRRD_LAYOUT_H_
#define ISOSCOPE_CORE_FORMATS_MEDICAL_NRRD_LAYOUT_H_

#include <cstdint>
#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/formats/medical/nrrd_grid.h"
#include "core/source/adapt/wide_source.h"
#include "core/source/bytes/text_header.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

struct NrrdSampleType {
  volume::ScalarType scalar = volume::ScalarType::kUint8;  // of `wide`, its carrier
  std::optional<WideType> wide = std::nullopt;
};
// The type of that name ("unsigned short", "uint16_t"); not set if samples have no such type.
std::optional<NrrdSampleType> NrrdTypeFromName(absl::string_view name);

struct NrrdLayout {
  NrrdGrid grid;  // of the three axes of space
  NrrdSampleType type;
  std::int64_t tuples = 1;    // samples on an axis before those of space
  std::int64_t volumes = 1;   // on one behind them
  bool is_time = false;       // whichever of both is above 1
  double first_time = 0;      // of the first step
  double interval = 1;        // between steps; 1, without a unit, if the header does not say
  std::string time_unit{};    // may be empty
  std::string sample_unit{};  // may be empty
};

// The fields of the header. Errors as LocateNrrdSamples.
absl::StatusOr<HeaderFields> ReadNrrdFields(const std::string& path);

// Reads a header of four axes. The one that is not of space is known by its kind ("list",
// "3-vector", "time", ...), or by its space direction "none"; it must be the first or the last.
// INVALID_ARGUMENT: not four axes, or not one such among them; a type or numbers that are none;
// steps that are not above 0 apart, or begin somewhere at no known distance; as ReadNrrdGrid.
absl::StatusOr<NrrdLayout> ReadNrrdLayout(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_MEDICAL_NRRD_LAYOUT_H_
