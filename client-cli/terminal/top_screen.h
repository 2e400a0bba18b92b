// The text of `isoscope top`: the work of a cluster, from one answer of GetClusterStatus and an
// earlier one.
//
// Rates are differences of counters over the time of the process that counts. The tables are
// cluster, agents and frames. If they do not fit, columns become narrower, then lines are cut, and
// the last line counts the frames that are not shown.

#ifndef ISOSCOPE_CLIENT_CLI_TERMINAL_TOP_SCREEN_H_
#define ISOSCOPE_CLIENT_CLI_TERMINAL_TOP_SCREEN_H_

#include <optional>
#include <string>
#include <vector>

#include "absl/time/time.h"

#include "core/base/monotonic_time.h"
#include "isoscope/v1/cluster_service.pb.h"

namespace isoscope::cli {

struct ClusterSample {
  base::MonotonicTime time = {};
  absl::Time date = {};  // of the same moment, as the screen shows it
  isoscope::v1::GetClusterStatusResponse status;
};

struct TopScreenOptions {
  std::string server;
  // Columns and lines of the screen. Wide columns are narrowed first, then lines are cut; frames
  // without room are counted. 0: no limit.
  int width = 0;
  int height = 0;
};

// Returns the lines, without line feeds and control characters. Rates cover the time since
// `before`, by the clock of each process. Without `before`, or if a process was restarted
// meanwhile, they cover the time since its start.
std::vector<std::string> TopScreen(const ClusterSample& now,
                                   const std::optional<ClusterSample>& before,
                                   const TopScreenOptions& options);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_TERMINAL_TOP_SCREEN_H_
