// The output of `info`: volumes, datasets and agents as JSON and as text.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_DATASET_JSON_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_DATASET_JSON_H_

#include <cstdint>
#include <optional>
#include <string>

#include "client-cli/output/info_lines.h"
#include "core/source/adapt/value_range.h"
#include "core/source/volume_source.h"
#include "core/store/shard_reader.h"
#include "isoscope/v1/cluster_service.pb.h"
#include "isoscope/v1/dataset.pb.h"

namespace isoscope::cli {

// {"name", "dataset_id", "source", "sample_dims", "spacing", "origin", "direction", "sample_type",
// "value_range", "max_gradient_magnitude", "block_cells", "block_count", "shard_count",
// "patient_frame", "missing_shards"}; direction is a list of three columns; value_range is null if
// every sample is NaN; max_gradient_magnitude and patient_frame are null if there is none.
// "finite_range" follows value_range where that has an infinite end and a sample is finite. A
// series has "length_unit", "time_unit", "fields" and "time_steps" too (series_json.h): what all
// shards serve.
Json DatasetToJson(const isoscope::v1::Dataset& dataset);
// {"name", "sample_dims", "spacing", "origin", "direction", "sample_type", "value_range"}, each as
// above; "infinite_count", of samples beside the range; both only if samples were read. "note": how
// the grid differs from that of the file, if it does.
Json VolumeToJson(const source::VolumeSource& source,
                  const std::optional<source::ValueRange>& values);
// {"address", "state", "message", "version", "renderer", "shards": [{"dataset", "shard",
// "block_count"}]}; state is "reachable", "unreachable" or "unknown".
Json AgentToJson(const isoscope::v1::AgentStatus& agent);
// DatasetToJson with three members of the folder: "distribution", "seed", and "shards": [{"shard",
// "block_count", "block_bytes"}]; "levels" (level_json.h) if there are any.
Json DatasetDirectoryToJson(const store::DatasetDescription& description);

// The text for users, from the JSON above. The range of a volume's values is a separate line,
// because it may be printed later.
std::string DescribeVolume(const Json& volume);
std::string DescribeValueRange(const Json& json);
// ", and 3 infinite samples"; "" of 0.
std::string DescribeInfinite(std::int64_t count);
// A dataset of a server or of a folder, also of a series, with its labels. max_width: as
// Table::ToString.
std::string DescribeDataset(const Json& dataset, int max_width = 0);
// Returns a table with one row for each agent. max_width: as Table::ToString. With a width, a
// message that several agents share is printed once, below.
std::string DescribeAgents(const Json& agents, int max_width = 0);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_DATASET_JSON_H_
