// The output of `info` for a series: as JSON and as text.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_SERIES_JSON_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_SERIES_JSON_H_

#include <string>

#include <nlohmann/json_fwd.hpp>

#include "client-cli/output/dataset_json.h"
#include "core/store/series_manifest.h"

namespace isoscope::cli {

// The members of DatasetDirectoryToJson without samples_digest, sample_type, value_range and
// max_gradient_magnitude; shards are [{"shard", "volume_count", "file_bytes"}]. And
//
//   "length_unit"       null if unknown
//   "time_unit"         null if unknown
//   "fields"            [{
//     "name"            of the field
//     "long_name"
//     "unit"
//     "components"      [{"name", "sample_type", "value_range", "finite_range",
//                       "max_gradient_magnitude"}]; ranges are over all steps; finite_range as in
//                       DatasetToJson
//     "time_steps"      numbers of the steps at which the field is there with all components
//                       }]
//   "time_steps"        [{"number", "value"}]; empty: one step without a time
//   "missing_volumes"   [{"field", "component", "step", "shards"}]: the shards of this folder that
//                       lack the volume; all if the series has none
Json SeriesDirectoryToJson(const store::SeriesDescription& description);

// The steps and the fields of a series for people, from this JSON or that of DatasetToJson.
// max_width: as Table::ToString.
std::string DescribeSteps(const Json& series);
std::string DescribeFields(const Json& series, int max_width = 0);

// The whole for people, from the JSON above. max_width: as Table::ToString.
std::string DescribeSeries(const Json& series, int max_width = 0);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_SERIES_JSON_H_
