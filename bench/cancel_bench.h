// Measures how long a cluster works on a frame after its client has cancelled it.
//
// A cluster in this process renders frames. Each is cancelled at a random moment of its expected
// time. An agent is idle once it has no frame in work. The first frame of a started cluster is
// cold: its agents have neither samples nor meshes. The cluster is restarted regularly, so that a
// fixed share of the cancelled frames is cold.

#ifndef ISOSCOPE_BENCH_CANCEL_BENCH_H_
#define ISOSCOPE_BENCH_CANCEL_BENCH_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "bench/measurement.h"
#include "client-cli/session/embedded_cluster.h"
#include "clients/cpp/request/render_request.h"
#include "core/cli/command.h"

namespace isoscope::bench {

struct CancelBenchPlan {
  cli::EmbeddedClusterOptions cluster;
  client::RequestFlags request;
  double orbit_degrees = 7;  // from each frame to the next
  int cancel_count = 500;
  int frames_per_start = 5;  // cancelled frames between restarts of the cluster
  std::uint64_t seed = 1;    // of the moments
};

// One cancelled frame. Its last two times count from the cancel.
struct CancelledFrame {
  bool is_cold = false;
  double moment_ms = 0;  // of the cancel, from the request
  double answer_ms = 0;  // until the client's call returned
  double idle_ms = 0;    // until all agents were idle
};

struct CancelBenchResult {
  Drawers drawers;
  // Times of frames that are not cancelled.
  double cold_ms = 0;
  double following_ms = 0;
  std::vector<CancelledFrame> frames;
  // Frames that were complete before their moment; not in `frames`.
  int complete_count = 0;
};

// Cancels `cancel_count` frames. CANCELLED on an interrupt; DEADLINE_EXCEEDED if agents are not
// idle within a minute; errors of EmbeddedCluster::Start and of rendering.
absl::StatusOr<CancelBenchResult> RunCancelBench(const CancelBenchPlan& plan,
                                                 const cli::Context& context);

// A table with a row for cold frames, following frames and all: median, p99 and the largest.
std::string DescribeCancelBench(const CancelBenchResult& result);

// {"machine", "date", "volume", "isovalue", "width", "height", "agents", "renderer", "seed",
// "cold_ms", "following_ms", "complete_count", "idle_ms": {"median", "p99", "max"}, "frames":
// [{"cold", "moment_ms", "answer_ms", "idle_ms"}]}.
std::string CancelBenchJson(const Occasion& occasion, const CancelBenchPlan& plan,
                            const CancelBenchResult& result);

}  // namespace isoscope::bench

#endif  // ISOSCOPE_BENCH_CANCEL_BENCH_H_
