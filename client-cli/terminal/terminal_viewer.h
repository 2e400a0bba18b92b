// `isoscope view --terminal`: surfaces in the terminal, turned with the keys.

#ifndef ISOSCOPE_CLIENT_CLI_TERMINAL_TERMINAL_VIEWER_H_
#define ISOSCOPE_CLIENT_CLI_TERMINAL_TERMINAL_VIEWER_H_

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"

#include "client-cli/session/session.h"
#include "client-cli/terminal/show_picture.h"
#include "clients/cpp/request/label_flags.h"
#include "clients/cpp/request/level_flags.h"
#include "core/base/monotonic_time.h"
#include "core/cli/command.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::cli {

// The surfaces to begin with: of an isovalue, of labels, or both. One at least.
struct ViewedSurfaces {
  std::optional<double> isovalue = std::nullopt;
  std::vector<client::LabelSurface> labels = {};
  client::LevelFlags level = {};  // that they are drawn from
};

// Returns the flags of `render` that reproduce a frame of these surfaces, bit for bit. REQUIRES: it
// has a camera; a material is that of the first look.
std::string FlagsOfFrame(const isoscope::v1::RenderIsosurfaceRequest& frame,
                         const ViewedSurfaces& surfaces);

// The send times of a stream's states, by sequence number. While the view moves, a frame answers an
// older state than the newest. Thread-compatible.
class SentStates {
 public:
  void Add(std::int64_t sequence_number, base::MonotonicTime sent);
  // Returns the time from the state that a frame answers until `now`; nullopt if that state is not
  // known. Erases earlier states, which no later frame answers.
  std::optional<absl::Duration> TakeLatency(std::int64_t sequence_number, base::MonotonicTime now);

 private:
  std::map<std::int64_t, base::MonotonicTime> sent_;  // at most kMaxStates
};

// Shows the dataset on the terminal of this process until q or Ctrl-C, and restores the terminal.
// FAILED_PRECONDITION if there is no terminal, or one without pictures; errors of the Interact
// stream.
absl::Status RunTerminalViewer(const isoscope::v1::Dataset& dataset, const ViewedSurfaces& surfaces,
                               ShowMode mode, Session* session, const Context& context);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_TERMINAL_TERMINAL_VIEWER_H_
