// What `bench frame` prints: a table of frames, one of their steps, and JSON.

#ifndef ISOSCOPE_CLIENT_CLI_BENCH_FRAME_REPORT_H_
#define ISOSCOPE_CLIENT_CLI_BENCH_FRAME_REPORT_H_

#include <string>

#include "absl/strings/string_view.h"
#include "client-cli/bench_frame.h"
#include "client-cli/bench_statistics.h"
#include <nlohmann/json.hpp>

namespace isoscope::cli {

// One row for each case: times, the peer's and how many times ours they are, triangles, network
// bytes and how many times those of the fewest agents, busy time of the agents; then the steps of
// the first and of the following frames.
std::string DescribeFrameBench(absl::string_view volume, const FrameBenchResult& result);

// {"machine", "date", "volume", "width", "height", "frames", "runs", "orbit", "azimuth",
// "elevation", "cases": [{"isovalue", "agents", "culling", "renderer", "first", "following",
// "wall_ms", "network_growth"}], "peers": [{"isovalue", "cold_ms", "following_ms",
// "triangle_count", "runs"}]}.
nlohmann::ordered_json FrameBenchToJson(absl::string_view volume, const FrameBenchPlan& plan,
                                        const FrameBenchResult& result, const Machine& machine,
                                        absl::string_view timestamp);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_BENCH_FRAME_REPORT_H_
