// The statistics of frames, as the JSON of `--stats` and as tables for users.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_FRAME_STATISTICS_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_FRAME_STATISTICS_H_

#include <string>
#include <vector>

#include "isoscope/v1/frame.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::cli {

struct FrameRecord {
  double wall_ms = 0;  // the client's clock around one request
  isoscope::v1::RenderStatistics statistics;
  std::vector<isoscope::v1::SurfaceNote> notes = {};
};

// Returns {"frames": [...]}. Scripts depend on it: members may be added, never renamed or moved.
// Times are milliseconds with three decimals.
std::string StatisticsJson(const std::vector<FrameRecord>& frames);

// Returns the missing shards and the share that the picture shows; "" if none is missing.
std::string DescribeMissingShards(const isoscope::v1::RenderStatistics& statistics);

// Three tables: frames, their steps, and the agents of the last frame; and a warning for each frame
// that lacks shards. max_width: as Table::ToString.
std::string DescribeStatistics(const std::vector<FrameRecord>& frames, int max_width = 0);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_FRAME_STATISTICS_H_
