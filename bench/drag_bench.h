// Measures the frames of a dragged view: a client of the Interact stream that only acknowledges.
// The server is remote, or coordinator and agents run in this process.

#ifndef ISOSCOPE_BENCH_DRAG_BENCH_H_
#define ISOSCOPE_BENCH_DRAG_BENCH_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "bench/measurement.h"
#include "client-cli/session/session.h"
#include "clients/cpp/request/render_request.h"
#include "core/cli/command.h"

namespace isoscope::bench {

struct DragBenchPlan {
  cli::SessionFlags session;
  client::RequestFlags request;
  absl::Duration duration = absl::Seconds(10);
  double states_per_second = 60;  // a typical mouse rate
  double degrees_per_second = 60;
  double target_frames_per_second = 0;  // of ViewState
  absl::Duration decode;                // pretended decoding time of a frame
};

struct DragBenchResult {
  Drawers drawers;
  double drag_seconds = 0;
  std::int64_t frame_count = 0;      // moving frames that arrived during the drag
  std::vector<double> latencies_ms;  // from a state to its frame
  std::vector<double> heights_px;    // of each frame
  std::vector<double> frame_bytes;   // picture and depth grid
  double exact_ms = 0;               // from the last state to the exact frame
  bool exact_is_that_of_render = false;
};

// Warms up for a second, drags, rests, and compares the exact frame with RenderIsosurface. Errors
// of Session::Open and of Interact; CANCELLED on an interrupt.
absl::StatusOr<DragBenchResult> RunDragBench(const DragBenchPlan& plan,
                                             const cli::Context& context);

// A few lines: frames a second, latency, size, bytes, the time until the view was exact.
std::string DescribeDragBench(const DragBenchResult& result);

// {"machine", "date", "volume", "isovalue", "width", "height", "agents", "renderer",
// "frames_per_second", "latency_ms": {"median", "p95"}, "median_height_px", "median_frame_bytes",
// "exact_ms"}.
std::string DragBenchJson(const Occasion& occasion, const DragBenchPlan& plan,
                          const DragBenchResult& result);

}  // namespace isoscope::bench

#endif  // ISOSCOPE_BENCH_DRAG_BENCH_H_
