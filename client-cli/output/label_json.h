// The output of `info` for the labels of a volume or a dataset: as JSON and as text.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_LABEL_JSON_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_LABEL_JSON_H_

#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "client-cli/output/dataset_json.h"
#include "core/volume/label.h"

namespace isoscope::cli {

// Adds "labels": [{"value", "name", "color"}], color "#rrggbb" or null; nothing if there are none.
void AddLabels(const std::vector<volume::Label>& labels, Json* json);

// A table of these labels behind an empty line, the first 100 of them; "" if there are none. A
// colour that is missing is the one that surfaces get, in parentheses.
std::string DescribeLabels(const Json& json);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_LABEL_JSON_H_
