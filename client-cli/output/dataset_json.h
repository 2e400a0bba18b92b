// The output of `info`: volumes, datasets and agents as JSON and as text.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_DATASET_JSON_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_DATASET_JSON_H_

#include <optional>
#include <string>

#include <nlohmann/json_fwd.hpp>

#include "core/source/volume_source.h"
#include "core/store/shard_reader.h"
#include "core/volume/scalar_span.h"
#include "isoscope/v1/cluster_service.pb.h"
#include "isoscope/v1/dataset.pb.h"

namespace isoscope::cli {

using Json = nlohmann::ordered_json;

// {"name", "dataset_id", "source", "sample_dims", "spacing", "origin", "direction", "sample_type",
// "value_range", "max_gradient_magnitude", "block_cells", "block_count", "shard_count",
// "patient_frame", "missing_shards"}; direction is a list of three columns; value_range is null if
// every sample is NaN; max_gradient_magnitude and patient_frame are null if there is none.
Json DatasetToJson(const isoscope::v1::Dataset& dataset);
// {"name", "sample_dims", "spacing", "origin", "direction", "sample_type", "value_range"}, each as
// above; no value_range where nobody has read the samples.
Json VolumeToJson(const source::VolumeSource& source,
                  const std::optional<volume::ScalarSpan>& value_range);
// {"address", "state", "message", "version", "renderer", "shards": [{"dataset", "shard",
// "block_count"}]}; state is "reachable", "unreachable" or "unknown".
Json AgentToJson(const isoscope::v1::AgentStatus& agent);
// DatasetToJson with three members that only the folder knows: "distribution", "seed", and
// "shards":
// [{"shard", "block_count", "block_bytes"}].
Json DatasetDirectoryToJson(const store::DatasetDescription& description);

// The same for people, from the JSON above. Of a volume the range of values is a line of its own,
// since it may come later.
std::string DescribeVolume(const Json& volume);
std::string DescribeValueRange(const Json& json);
std::string DescribeDataset(const Json& dataset);
// A table with one row for each agent. max_width: as Table::ToString; if there is one, a message
// that several agents have stands once, below.
std::string DescribeAgents(const Json& agents, int max_width = 0);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_DATASET_JSON_H_
