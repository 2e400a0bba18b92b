#include "bench/measurement.h"

#include <ostream>

#include <nlohmann/json.hpp>

#include "core/base/status_macros.h"
#include "core/io/atomic_file.h"

namespace isoscope::bench {

nlohmann::ordered_json JsonHead(const Occasion& occasion) {
  return {{"machine", ToString(occasion.machine)}, {"date", occasion.date}};
}

absl::Status RunMeasurement(
    const std::optional<std::string>& json_path, absl::string_view volume,
    const cli::Context& context,
    const std::function<absl::StatusOr<Report>(const Occasion& occasion)>& measure) {
  if (json_path) {
    ISOSCOPE_RETURN_IF_ERROR(io::CheckWritable(*json_path));
  }
  const Occasion occasion{
      .machine = DescribeMachine(), .date = Timestamp(), .volume = std::string(volume)};
  ISOSCOPE_ASSIGN_OR_RETURN(const Report report, measure(occasion));
  if (json_path) {
    ISOSCOPE_RETURN_IF_ERROR(io::WriteFileAtomically(*json_path, report.json));
  }
  *context.out << ToString(occasion.machine) << "; " << occasion.date << "\n" << report.text;
  return absl::OkStatus();
}

}  // namespace isoscope::bench
