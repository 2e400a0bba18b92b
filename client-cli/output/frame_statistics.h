// The statistics of frames, as the JSON of `--stats` and as tables for users.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_FRAME_STATISTICS_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_FRAME_STATISTICS_H_

#include <optional>
#include <string>
#include <vector>

#include "client-cli/output/surface_measures.h"
#include "isoscope/v1/frame.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::cli {

// Areas and volumes of the whole surfaces of a frame, seen or hidden.
struct FrameMeasures {
  std::string length_unit;  // empty: unknown
  std::vector<MeasuredSurface> surfaces;
};

struct FrameRecord {
  double wall_ms = 0;  // the client's clock around one request
  isoscope::v1::RenderStatistics statistics;
  isoscope::v1::RenderIsosurfaceRequest request = {};
  std::optional<isoscope::v1::DrawnLevel> drawn_level = std::nullopt;  // of the answer
  std::vector<isoscope::v1::SurfaceNote> notes = {};
  std::optional<FrameMeasures> measures = std::nullopt;  // not set: not measured
};

// Returns {"frames": [...]}. Scripts depend on it: members may be added, never renamed or moved.
// Times are milliseconds with three decimals. A frame with measures has "measures", as
// MeasuresToJson.
std::string StatisticsJson(const std::vector<FrameRecord>& frames);

// Returns the missing shards and the share that the picture shows; "" if none is missing.
std::string DescribeMissingShards(const isoscope::v1::RenderStatistics& statistics);

// Returns a line with the number of bands of the frames that were drawn in bands; "" if none was.
std::string DescribeBands(const std::vector<FrameRecord>& frames);

// Returns a line with the levels that frames were drawn from, and of one level with what it hides in
// the last frame; "" if no frame chose one.
std::string DescribeLevels(const std::vector<FrameRecord>& frames);

// Tables of frames, their steps, and the agents and measures of the last frame. max_width: as
// Table::ToString.
std::string DescribeStatistics(const std::vector<FrameRecord>& frames, int max_width = 0);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_FRAME_STATISTICS_H_
