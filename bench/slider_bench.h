// Measures the cost of a new isovalue at the same view: a slider moves through some isovalues, and
// once more through the same ones. The server is remote, or coordinator and agents run in this
// process.

#ifndef ISOSCOPE_BENCH_SLIDER_BENCH_H_
#define ISOSCOPE_BENCH_SLIDER_BENCH_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "bench/measurement.h"
#include "client-cli/session/session.h"
#include "clients/cpp/request/render_request.h"
#include "core/cli/command.h"

namespace isoscope::bench {

struct SliderBenchPlan {
  cli::SessionFlags session;
  client::RequestFlags request;  // its isovalue is the first
  double last_isovalue = 0;
  int step_count = 20;   // isovalues, the first and the last among them; at least 4
  absl::Duration pause;  // between frames, as in manual use
};

// One frame of the slider, as the client sees it.
struct SliderFrame {
  double isovalue = 0;
  double ms = 0;
  double kernel_ms = 0;  // of all threads of this process
  double grown_mib = 0;  // growth of the resident set of this process
};

struct SliderBenchResult {
  Drawers drawers;
  bool is_in_process = false;       // else kernel_ms and grown_mib are those of a client
  std::vector<SliderFrame> first;   // each isovalue for the first time, without the first two
  std::vector<SliderFrame> second;  // the same once more, in the same order
  bool is_repeatable = false;       // both passes gave the same bytes
};

// Renders every isovalue twice. Errors of Session::Open and of RenderIsosurface; CANCELLED on an
// interrupt.
absl::StatusOr<SliderBenchResult> RunSliderBench(const SliderBenchPlan& plan,
                                                 const cli::Context& context);

// A table of two rows: medians of the times, of kernel time and of new memory.
std::string DescribeSliderBench(const SliderBenchResult& result);

// {"machine", "date", "volume", "isovalues": [first, last], "width", "height", "agents",
// "renderer", "new": {"median_ms", "p95_ms", "median_kernel_ms", "median_grown_mib"}, "again":
// {...}}.
std::string SliderBenchJson(const Occasion& occasion, const SliderBenchPlan& plan,
                            const SliderBenchResult& result);

}  // namespace isoscope::bench

#endif  // ISOSCOPE_BENCH_SLIDER_BENCH_H_
