// The common parts of all measurements: the machine and the date, and the report as JSON and as
// text.

#ifndef ISOSCOPE_BENCH_MEASUREMENT_H_
#define ISOSCOPE_BENCH_MEASUREMENT_H_

#include <functional>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include <nlohmann/json_fwd.hpp>

#include "bench/machine.h"
#include "core/cli/command.h"

namespace isoscope::bench {

// The default camera of measurements, in degrees.
inline constexpr double kDefaultAzimuth = 30;
inline constexpr double kDefaultElevation = 20;

// The circumstances of a measurement.
struct Occasion {
  Machine machine = {};
  std::string date = {};    // of Timestamp
  std::string volume = {};  // its file, folder or dataset, by name
};

// Returns {"machine", "date"}, the first members of every measurement's JSON.
nlohmann::ordered_json JsonHead(const Occasion& occasion);
struct Report {
  std::string json;
  std::string text;
};
// Measures and writes the report. The JSON goes to `json_path`, if there is one, after a check
// before the measurement that it is writable. The text follows a line of machine and date.
absl::Status RunMeasurement(
    const std::optional<std::string>& json_path, absl::string_view volume,
    const cli::Context& context,
    const std::function<absl::StatusOr<Report>(const Occasion& occasion)>& measure);

}  // namespace isoscope::bench

#endif  // ISOSCOPE_BENCH_MEASUREMENT_H_
