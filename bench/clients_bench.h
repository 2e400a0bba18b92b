// Measures many clients of one server that repeatedly request the same picture. Each has its own
// connection, and retries after the server's delay when it is refused. The result has the
// throughput of all, and the times of each.

#ifndef ISOSCOPE_BENCH_CLIENTS_BENCH_H_
#define ISOSCOPE_BENCH_CLIENTS_BENCH_H_

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

struct ClientsBenchPlan {
  cli::SessionFlags session;  // names a server
  client::RequestFlags request;
  std::vector<int> client_counts = {4, 16, 64};  // one round for each, in this order
  absl::Duration duration = absl::Seconds(15);   // of a round
  absl::Duration warm_up = absl::Seconds(2);     // before it, not counted
};

// A round with one number of clients. A frame's time is that from its first attempt to its answer.
struct ClientsRound {
  int client_count = 0;
  std::int64_t frame_count = 0;
  double frames_per_second = 0;
  double p50_ms = 0;
  double p95_ms = 0;
  double p99_ms = 0;
  double max_ms = 0;
  // Most and fewest frames of a client.
  std::int64_t most_frames = 0;
  std::int64_t least_frames = 0;
  std::int64_t refusal_count = 0;  // includes the warm-up, as all that follow
  std::int64_t retry_count = 0;
  std::int64_t wrong_count = 0;   // pictures with other bytes than the first one
  std::int64_t failed_count = 0;  // frames that ended with an error
  std::string first_error = {};   // of them
};

// Errors of the connection flags and of the first frame, which is drawn before the rounds;
// CANCELLED on an interrupt. REQUIRES: the session names a server.
absl::StatusOr<std::vector<ClientsRound>> RunClientsBench(const ClientsBenchPlan& plan,
                                                          const cli::Context& context);

// A table of one row for each round.
std::string DescribeClientsBench(const std::vector<ClientsRound>& rounds);

// {"machine", "date", "server", "isovalues", "width", "height", "seconds", "rounds": [{"clients",
// "frames", "frames_per_second", "p50_ms", "p95_ms", "p99_ms", "max_ms", "most_frames",
// "least_frames", "refusals", "retries", "wrong", "failed"}]}.
std::string ClientsBenchJson(const Occasion& occasion, const ClientsBenchPlan& plan,
                             const std::vector<ClientsRound>& rounds);

}  // namespace isoscope::bench

#endif  // ISOSCOPE_BENCH_CLIENTS_BENCH_H_
