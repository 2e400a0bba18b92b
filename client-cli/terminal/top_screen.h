// The text of `isoscope top`: what a cluster does, made of one answer of GetClusterStatus and the
// one before.

#ifndef ISOSCOPE_CLIENT_CLI_TERMINAL_TOP_SCREEN_H_
#define ISOSCOPE_CLIENT_CLI_TERMINAL_TOP_SCREEN_H_

#include <optional>
#include <string>
#include <vector>

#include "absl/time/time.h"

#include "isoscope/v1/cluster_service.pb.h"

namespace isoscope::cli {

struct ClusterSample {
  absl::Time time;
  isoscope::v1::GetClusterStatusResponse status;
};

struct TopScreenOptions {
  std::string server;
  // Columns and lines that there is room for. Columns that people can do without in part get
  // narrower, then lines are cut; frames that find no room are counted. 0: no limit.
  int width = 0;
  int height = 0;
};

// Returns the lines, without line feeds and control characters. Rates are those since `before`, by
// the clock of each process; without it, or if a process began anew meanwhile, since it began.
std::vector<std::string> TopScreen(const ClusterSample& now,
                                   const std::optional<ClusterSample>& before,
                                   const TopScreenOptions& options);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_TERMINAL_TOP_SCREEN_H_
