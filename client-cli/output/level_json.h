// The levels of a dataset folder in the output of `info`, as JSON and as text.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_LEVEL_JSON_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_LEVEL_JSON_H_

#include <string>
#include <vector>

#include "client-cli/output/info_lines.h"
#include "core/store/manifest.h"
#include "core/store/series_manifest.h"

namespace isoscope::cli {

// [{"level", "sample_dims", "spacing", "sample_type", "value_scale", "filter", "sample_bytes",
// "missing_shards"}] of levels 1 and higher; the last one has the shards whose folders lack the
// level.
//
// shard_directories: by shard index; "" where one is not here
Json LevelsToJson(const store::Manifest& manifest,
                  const std::vector<std::string>& shard_directories);
// [{"level", "sample_dims", "spacing", "volume_count"}]: the volumes that have the level.
Json LevelsToJson(const store::SeriesManifest& series);

// A line for each level of the JSON of a dataset; "" if that has no member "levels".
std::string DescribeLevels(const Json& dataset);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_LEVEL_JSON_H_
