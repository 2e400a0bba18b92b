// The output of `bench frame`: a table of frames, one of their steps, and JSON.

#ifndef ISOSCOPE_BENCH_FRAME_BENCH_REPORT_H_
#define ISOSCOPE_BENCH_FRAME_BENCH_REPORT_H_

#include <string>

#include "absl/strings/string_view.h"

#include "bench/frame_bench.h"
#include "bench/measurement.h"

namespace isoscope::bench {

// Returns two tables. Frames has a row for each case: our times, the peer's and their ratio to
// ours, triangles, network bytes and their ratio to those of the fewest agents, busy time of the
// agents. Steps has the steps of the first and of the following frames.
std::string DescribeFrameBench(absl::string_view volume, const FrameBenchResult& result);

// {"machine", "date", "volume", "width", "height", "frames", "runs", "orbit", "azimuth",
// "elevation", "cases": [{"isovalue", "agents", "culling", "renderer", "first", "following",
// "wall_ms", "network_growth"}], "peers": [{"isovalue", "cold_ms", "following_ms",
// "triangle_count", "runs"}]}.
std::string FrameBenchJson(const Occasion& occasion, const FrameBenchPlan& plan,
                           const FrameBenchResult& result);

}  // namespace isoscope::bench

#endif  // ISOSCOPE_BENCH_FRAME_BENCH_REPORT_H_
