// Tells what `info` says of a source beside its grid: fields, steps, what partitioning takes, the
// command that draws it.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_SOURCE_JSON_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_SOURCE_JSON_H_

#include <cstdint>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "client-cli/output/dataset_json.h"
#include "core/math/vec.h"
#include "core/source/adapt/value_range.h"
#include "core/source/series_entry.h"
#include "core/source/volume_series.h"
#include "core/volume/scalar_type.h"

namespace isoscope::cli {

// The needs of `partition` with its defaults; rules of thumb, from measurements (docs/formats.md).
struct PartitionNeeds {
  std::int64_t disk_bytes = 0;
  std::int64_t memory_bytes = 0;  // of the process, at most
  double seconds = 0;
};
// `volume_count` scalar volumes: components, their magnitudes, steps.
PartitionNeeds EstimatePartition(const math::Index3& dims, volume::ScalarType type,
                                 std::int64_t volume_count);

// The values of a source of several volumes.
struct SourceRanges {
  int steps = 0;                                          // that were read, from the first one on
  std::vector<std::vector<source::ValueRange>> ranges{};  // [field][component], if any was read
};

// Adds to `volume`, the JSON of the first volume (VolumeToJson):
//
//   "fields"              [{"name", "unit", "components", "value_ranges", "infinite_counts"}]
//   "elsewhere"           paths of what lies on other grids; if there is any
//   "time_steps", "time_unit", "length_unit"
//   "partition"           {"disk_bytes", "memory_bytes", "seconds"}
//   "commands"            with DIR for a folder, and VALUE for an isovalue if no values were read;
//                         none if no isovalue has a surface
//   "value_range_steps"   if there are several volumes; without any step no field has value_ranges
//
// input:       the path with the flags that it needs, as one types them
// drawn_input: that of `isoscope render`
void AddSource(const source::VolumeSeries& series, const source::VolumeSource& first,
               const SourceRanges& ranges, const std::string& input, const std::string& drawn_input,
               Json* volume);
// Lines for these members.
std::string DescribeSource(const Json& volume);

// {"series": [{"number", "description", "uid", "width", "height", "images", "first_file"}]}.
Json SeriesEntriesToJson(const std::vector<source::SeriesEntry>& entries);
// A line for each, and the command that chooses one.
std::string DescribeSeriesEntries(const Json& json, const std::string& input);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_SOURCE_JSON_H_
